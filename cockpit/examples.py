"""The verb ``example``: what the documentation names, from the installation into a folder of the user.

These are its examples, and ``config``: the settings that the commands of the pages name as files.
"""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from trepid.config import CONFIG_DIR, EXAMPLES_DIR, InputError, read_text, refuse
from trepid.spelling import did_you_mean

app = typer.Typer(help="List and copy the examples of the documentation.", no_args_is_help=True)
SETTINGS = "config"  # the name of CONFIG_DIR, also in a wheel, where its folder has another


def examples() -> dict[str, Path]:
    """Name -> file or folder: the settings, and what stands in the folder of the examples or in folders there."""
    found = {SETTINGS: CONFIG_DIR}
    for path in sorted(EXAMPLES_DIR.iterdir()):
        below = [one for one in sorted(path.iterdir()) if one.is_dir()] if path.is_dir() else []
        if path.is_dir() and not any(one.is_file() for one in path.iterdir()):
            found |= {f"{path.name}/{one.name}": one for one in below}
        elif path.suffix != ".pyc" and path.name != "__pycache__":
            found[path.stem] = path
    return found


def copy_example(name: str, folder: Path, *, force: bool = False) -> list[Path]:
    """Copy the example ``name`` into ``folder``; the files that were written.

    Raises InputError for an unknown name, a file that exists unless ``force``, and where nothing can be written.
    """
    known = examples()
    if name not in known:
        raise InputError(f"no example {name!r}; {did_you_mean(name, known)}")
    source = known[name]
    files = [path for path in sorted(source.rglob("*")) if path.is_file()] if source.is_dir() else [source]
    files = [path for path in files if "__pycache__" not in path.parts]
    top = source if source.is_dir() else source.parent
    places = {path: folder / path.relative_to(top) for path in files}
    for place in places.values():
        refuse(f"{place}: exists and is kept; --force overwrites it", place.exists() and not force)
    try:
        for path, place in places.items():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, place)
    except OSError as error:
        raise InputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error
    return list(places.values())


@app.command("list")
def show() -> int:
    """List the examples with what each is."""
    for name, path in examples().items():
        print(f"{name:20} {description(path)}")
    return 0


def description(path: Path) -> str:
    """The first line of an example, without the signs of a comment; of a folder that of its README or processes."""
    if path == CONFIG_DIR:
        return "the settings of the installation, for commands that name a file of config/"
    if path.is_dir():
        path = next(one for name in ("README.md", "processes.yaml") if (one := path / name).is_file())
    if path.suffix == ".ipynb":
        return "a notebook: drive, record, draw, explain"
    return read_text(path).splitlines()[0].strip('#" ')


@app.command("copy")
def copy(
    name: Annotated[str, typer.Argument(help="Name of an example: `trepid example list`.", metavar="NAME")],
    folder: Annotated[
        Path | None,
        typer.Argument(help="Where to; default: its name, a file into this folder.", metavar="DIR"),
    ] = None,
    force: Annotated[bool, typer.Option(help="Overwrite files that exist.")] = False,
) -> int:
    """Copy an example, so that it can be run and changed."""
    where = folder or (Path(Path(name).name) if examples().get(name, Path()).is_dir() else Path())
    for path in copy_example(name, where, force=force):
        print(path)
    return 0
