"""``trepid init``: the folder of a new car, and the text of its settings files.

A file has the fields of its template, and all others as comments. The default file gives every field with its unit,
default and source. Each of its lines gets a ``#``, so that an edit is the removal of that character; the fields of
the template stand uncommented below their default.
"""

import re
from collections.abc import Mapping
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from cockpit.car.donkeycar import read_donkeycar
from trepid.config import CONFIG_DIR, WHOLE_FILES, InputError, read_text

_FIELD = re.compile(r"(\s*)([\w.-]+|\"[^\"]+\"|'[^']+')\s*:(?:\s|$)")
_ITEM = re.compile(r"\s*- ")


def merge(default: str, template: str) -> str:
    """The text of the default file with its fields as comments, and with the fields of ``template`` active.

    A field that both give as a block of further fields is merged line by line.
    """
    lines = _merge_lines(default.splitlines(), template.splitlines(), indent=0)
    return "\n".join(lines) + "\n"


def _merge_lines(default: list[str], template: list[str], indent: int) -> list[str]:
    above, ours = _blocks(template, indent)
    head, theirs = _blocks(default, indent)
    lines = [*above, *(_comment_out(line) for line in head)]
    for name, block in theirs.items():
        given = ours.pop(name, None)
        if given is None:
            lines += [_comment_out(line) for line in block]
            continue
        inner = _indent_below(block)
        if inner is not None and inner == _indent_below(given):
            lines += [given[0], *_merge_lines(block[1:], given[1:], inner)]
        else:
            kept, after = _without_end(block)
            lines += [*(_comment_out(line) for line in kept), *_without_end(given)[0]]
            lines += [_comment_out(line) for line in after]
    return lines + [line for block in ours.values() for line in block]


def _blocks(lines: list[str], indent: int) -> tuple[list[str], dict[str, list[str]]]:
    """The lines before the first field at ``indent``, and the lines of each field.

    Comments belong to the field above them.
    """
    starts = [
        number
        for number, line in enumerate(lines)
        if (found := _FIELD.match(line)) and len(found[1]) == indent
    ]
    spans = [lines[begin:end] for begin, end in pairwise([*starts, len(lines)])]
    head = lines[: starts[0]] if starts else lines
    return head, {str(_name(span[0])): span for span in spans}


def _name(line: str) -> str | None:
    found = _FIELD.match(line)
    return found[2].strip("\"'") if found else None


def _indent_below(block: list[str]) -> int | None:
    """Indentation of the fields below the first line of ``block``; None when it holds a value or a list."""
    for line in block[1:]:
        found = _FIELD.match(line)
        if _ITEM.match(line):
            return None
        if found:
            return len(found[1])
    return None


def _without_end(block: list[str]) -> tuple[list[str], list[str]]:
    """``block`` and the comments and empty lines at its end, which introduce the next field."""
    end = len(block)
    while end > 1 and (not block[end - 1].strip() or block[end - 1].lstrip().startswith("#")):
        end -= 1
    return block[:end], block[end:]


def _comment_out(line: str) -> str:
    """``line`` as a comment; empty lines and comments stay as they are."""
    return line if not line.strip() or line.lstrip().startswith("#") else f"#{line}"


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
