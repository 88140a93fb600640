"""The pages of the Python API: the docstrings of the functions that `docs/python.md` names, a page each package."""

import re
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import trepid
from trepid.config import ROOT
from trepid.packages import PACKAGES, offers

NAMED = re.compile(r"`((?:" + "|".join((*PACKAGES, "lab")) + r")(?:\.\w+)+)`")


def names() -> Mapping[str, list[str]]:
    """Package -> dotted names of its public functions and classes, in alphabetic order."""
    places = {name: module for one in offers() for name, module in one.functions.items()}
    table = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    found = {f"{places[name]}.{name}" for name in trepid.__all__ if name in places}
    found |= {name for name in NAMED.findall(table) if not name.startswith(("lab.", "trepid.run"))}
    found = {name for name in found if name.count(".") > 1} | {"trepid.config.InputError"}
    by_package = defaultdict(list)
    for name in sorted(found):
        by_package[name.partition(".")[0]].append(name)
    return by_package


def package_page(package: str) -> str:
    """The page of one package."""
    parts = [f"# Python: {package}"]
    parts += [f"::: {name}" for name in names()[package]]
    return "\n\n".join(parts) + "\n"


def messages_page() -> str:
    """The page of the messages and topics, with the source, whose comments hold units and signs."""
    parts = [
        "# Messages and topics",
        "Left is positive, units are SI and part of the name; `None` means absent. [Topics](#topics) "
        "follow the messages.",
        "::: trepid.messages\n    options: {show_source: true, members_order: source}",
        "## Topics",
        "::: trepid.topics\n    options: {show_source: true, members_order: source}",
    ]
    return "\n\n".join(parts) + "\n"


PAGES: Mapping[str, Callable[[], str]] = MappingProxyType(
    {f"python_{package}.md": partial(package_page, package) for package in names()}
)
"""Page of the site -> what writes it."""
