"""Hooks of MkDocs: pages from the code and from the rest of the repository, and links that stay within the site.

Links of pages lead from file to file in the repository, and from page to page on the site.
"""

import re
from collections.abc import Callable, Mapping
from posixpath import dirname, normpath, relpath
from types import MappingProxyType
from typing import Any

from mkdocs.structure.files import File, Files

from lab.bench.age import ages, with_ages
from lab.bench.results import stored_results
from lab.site import fields, python, verbs
from trepid.config import ROOT

OF_CODE: Mapping[str, Callable[[], str]] = MappingProxyType(
    {"files.md": fields.page, "verbs.md": verbs.page, "messages.md": python.messages_page, **python.PAGES}
)
"""Page of the site -> what writes it."""
RESULTS = "results.md"
OF_REPOSITORY = MappingProxyType(
    {
        "CHANGELOG.md": "changelog.md",
        "CONTRIBUTING.md": "contributing.md",
        "SECURITY.md": "security.md",
        "examples/add_on/README.md": "add_on.md",
        "lab/results/README.md": RESULTS,
    }
)
"""Page of the repository outside docs/ -> page of the site."""


def _pages(files: Files) -> dict[str, str]:
    """File of the repository -> file of the site, for every page and picture."""
    own = {f"docs/{file.src_uri}": file.src_uri for file in files}
    pictures = {f"lab/results/{path.name}": path.name for path in (ROOT / "lab" / "results").glob("*.png")}
    return {**own, **OF_REPOSITORY, **pictures}


def add_ages(text: str) -> str:
    """The page of results, where each result that is older than the code says so."""
    stored = stored_results(ROOT / "lab" / "results")
    return with_ages(text, ages({name: one.commit for name, one in stored.items()}))


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that stand nowhere below docs/."""
    for name, write in OF_CODE.items():
        files.append(File.generated(config, name, content=write()))
    for source, name in OF_REPOSITORY.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=add_ages(text) if name == RESULTS else text))
    for path in (ROOT / "lab" / "results").glob("*.png"):
        files.append(File.generated(config, path.name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """The text of a page with links of the site."""
    name = page.file.src_uri
    if name in OF_CODE:
        return markdown
    sources = {page: source for source, page in OF_REPOSITORY.items()}
    return lead_within(markdown, sources.get(name, f"docs/{name}"), name, _pages(files))


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
