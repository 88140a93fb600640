"""``trepid init``: the folder of a new car."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from cockpit.car.donkeycar import read_donkeycar
from cockpit.car.template import merge
from trepid.config import CONFIG_DIR, WHOLE_FILES, InputError, read_text

TEMPLATES = CONFIG_DIR / "cars"
FILES = (
    "vehicle.yaml",
    "camera.yaml",
    "camera_source.yaml",
    "actuator.yaml",
    "limiter.yaml",
    "fear.yaml",
    "processes.yaml",
    "drive.yaml",
)
"""Written for every car, beside the files of its template."""
SCHEMAS = ("fear.json", "scenario.json")
HEADER = """\
# This car's {name}. A line "#field: value" is a field with its default: delete the "#" to change it, and that of
# the line that it stands below. Fields that stay comments follow the defaults of the installed Trepid.
#
"""
WHOLE_HEADER = "# This car's {name}, which replaces the default as a whole.\n#\n"


class Like(StrEnum):
    """Templates of cars."""

    SHUTTLE = "shuttle"
    RC_CAR = "rc-car"
    MINI = "mini"
    DUCKIEBOT = "duckiebot"
    SIM = "sim"


BASES: Mapping[Like, Like] = MappingProxyType({Like.DUCKIEBOT: Like.MINI})
"""Template -> the one whose settings it has beside its own files."""


def template_files(like: Like) -> dict[str, Path]:
    """The files of a template by their names in the folder of a car."""
    base = template_files(BASES[like]) if like in BASES else {}
    base = {name: path for name, path in base.items() if "/" not in name}
    folder = TEMPLATES / like
    own = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return base | own


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder to write; must be empty or new.")],
    like: Annotated[Like, typer.Option(help="The car to begin with.")] = Like.SIM,
    donkeycar: Annotated[
        Path | None,
        typer.Option(metavar="myconfig.py", help="Pulses and camera of a donkeycar; with --like rc-car."),
    ] = None,
) -> int:
    """Write the folder of a new car: commented YAML files that override the defaults field by field."""
    if donkeycar is not None and like is not Like.RC_CAR:
        raise InputError(f"--donkeycar {donkeycar}: is for --like rc-car")
    found = read_donkeycar(donkeycar) if donkeycar is not None else None
    written = write_car(folder, like, found.files if found else {})
    print(f"{folder}: {', '.join(written)}")
    if found:
        print(f"From {donkeycar}: {', '.join(found.taken) or 'defaults of donkeycar alone'}")
        print(f"Not taken over: {', '.join(found.left) or 'nothing'}")
    print(f"Next: edit the files, then `trepid doctor --car {folder}` and `trepid drive --car {folder}`.")
    return 0


def write_car(folder: Path, like: Like, given: Mapping[str, str] = MappingProxyType({})) -> list[str]:
    """Write the files of a car like ``like`` into ``folder``; return their names. Raises InputError.

    ``given``: fields as YAML, by the name of a file, in place of those of the template.
    """
    own = template_files(like)
    texts = {
        name: file_text(name, own.get(name)) for name in FILES if name in own or (CONFIG_DIR / name).is_file()
    }
    texts |= {name: file_text(name, own[name]) for name in sorted(own.keys() - texts.keys())}
    texts |= {
        name: HEADER.format(name=name) + merge(read_text(CONFIG_DIR / name), own)
        for name, own in given.items()
    }
    texts |= {f"schema/{name}": read_text(CONFIG_DIR / "schema" / name) for name in SCHEMAS}
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: exists and is not an empty folder; name a new one")
        for name, text in texts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error
    return [name for name in texts if not name.startswith("schema/")]


def file_text(name: str, of_template: Path | None) -> str:
    """The text of the file ``name`` of a car, with the fields of ``of_template``, that of its template."""
    own = read_text(of_template) if of_template is not None else ""
    if name in WHOLE_FILES:
        default = read_text(CONFIG_DIR / name)
        first, _, rest = (own or default).partition("\n")  # editors expect the schema in the first line
        return f"{first}\n{WHOLE_HEADER.format(name=name)}{rest}"
    if "/" in name or not (CONFIG_DIR / name).is_file():
        return own
    return HEADER.format(name=name) + merge(read_text(CONFIG_DIR / name), own)
