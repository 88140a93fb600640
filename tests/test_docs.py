"""Links between the pages of the documentation lead somewhere."""

import re
from pathlib import Path

import pytest

from trepid.config import ROOT
from trepid.packages import PACKAGES

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += [ROOT / "lab" / "results" / "README.md"]
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
PLACE = re.compile(r"\]\(([^)#:]*)#([^)]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
PAGE_OF_SOURCE = re.compile(r"docs/[a-z_/]+\.md")
TEXT = {".py", ".yaml", ".toml", ".md", ".html"}
CAR = ("trepid", "perception", "supervisor", "controller", "vehicle", "drive")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_of_a_page_leads_to_a_file(page: Path) -> None:
    targets = [target for target in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []


def anchor(heading: str) -> str:
    """The name by which GitHub links to a heading: lower case, without punctuation, hyphens for spaces."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_to_a_place_in_a_page_leads_to_a_heading(page: Path) -> None:
    places = [
        ((page.parent / target if target else page), place)
        for target, place in PLACE.findall(page.read_text(encoding="utf-8"))
    ]
    known = {
        target: {anchor(text) for text in HEADING.findall(target.read_text(encoding="utf-8"))}
        for target, _ in places
    }
    assert [(target.name, place) for target, place in places if place not in known[target]] == []


def test_every_page_that_code_or_configuration_names_exists() -> None:
    named = {
        page
        for top in (ROOT / "config", *(ROOT / name for name in ("trepid", "perception", "supervisor")))
        for path in top.rglob("*")
        if path.suffix in TEXT
        for page in PAGE_OF_SOURCE.findall(path.read_text(encoding="utf-8"))
    }
    assert [page for page in sorted(named) if not (ROOT / page).is_file()] == []
    assert named  # the search finds a name


def rooms(packages: tuple[str, ...]) -> set[str]:
    """The rooms right below the ``packages``."""
    return {
        f"{package}/{path.name}/"
        for package in packages
        for path in (ROOT / package).iterdir()
        if (path / "__init__.py").is_file()
    }


def test_the_map_of_the_architecture_names_the_rooms_that_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| `([a-z_]+)/(?:([a-z_]+)/)?` \| (.*) \|$", text, re.MULTILINE)
    own = {f"{package}/{name}/" for package, name, _ in lines if name and package in PACKAGES}
    within = {
        f"{package}/{name}/"
        for package, row, cell in lines
        if not row
        for name in re.findall(r"`([a-z_]+)/`", cell)
    }
    assert own | within == rooms(PACKAGES)


def test_the_tree_of_the_car_in_the_readme_names_the_rooms_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    tree = re.search(r"What runs in a car:\n\n```\n(.*?)```", text, re.DOTALL)
    assert tree is not None
    named, package = set(), ""
    for line in tree[1].splitlines():
        package = line.partition("/")[0] if not line.startswith(" ") else package
        below = line if line.startswith(" ") else line.partition("/")[2]
        named |= {f"{package}/{name}/" for name in re.findall(r"(?<!\S)([a-z_]+)/(?= )", below)}
    assert named == rooms(CAR)
