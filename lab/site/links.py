"""Links of pages, which lead from file to file in the repository, as links from page to page of the site."""

import re
from collections.abc import Mapping
from posixpath import dirname, normpath, relpath

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")


def lead_within(text: str, source: str, page: str, pages: Mapping[str, str]) -> str:
    """``text`` of the repository's file ``source``, which the site shows as ``page``, with links of the site.

    ``pages``: file of the repository -> page or picture of the site. A link to any other file, which a reader of
    the site does not have, becomes its text and the path in the repository.
    """

    def link(match: re.Match[str]) -> str:
        picture, words, target, place = match.groups()
        file = normpath(f"{dirname(source)}/{target}".lstrip("/"))
        if file in pages:
            return f"{picture}[{words}]({relpath(pages[file], dirname(page) or '.')}{place or ''})"
        return words if file in words else f"{words} (`{file}`)"

    return LINK.sub(link, text)
