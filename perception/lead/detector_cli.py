"""``trepid detector``: detectors of real vehicles."""

from typing import Annotated

import typer

from perception.lead.published import PUBLISHED, fetch, file_of
from trepid.config import InputError

app = typer.Typer(no_args_is_help=True, help="Detectors of vehicles on real roads.")


@app.command("list")
def list_detectors() -> None:
    """Print the detectors that can be fetched by name."""
    for name, published in PUBLISHED.items():
        where = "fetched" if file_of(name).is_file() else "not fetched"
        print(f"{name:12} {published.package}, {published.licence}, {published.size / 1e6:.0f} MB: {where}")


@app.command("fetch")
def fetch_detector(name: Annotated[str, typer.Argument(help="As `trepid detector list` prints it.")]) -> None:
    """Get a detector from the registry of its publisher, once; `detector: NAME` in lead.yaml uses it."""
    if name not in PUBLISHED:
        raise InputError(f"no detector {name!r}; there are {', '.join(PUBLISHED)}")
    print(fetch(name))
