"""Hooks of MkDocs: pages from the code and from the rest of the repository, and links that stay within the site."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from mkdocs.structure.files import File, Files

from lab.bench.age import ages, with_ages
from lab.bench.results import stored_results
from lab.site import fields, python, verbs
from lab.site.links import lead_within
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
