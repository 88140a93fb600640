"""YAML files as frozen, validated settings; errors give file:line:column, the fault and the expected value.

The files of ``config/`` hold the defaults. A car is a folder of files with the same names; each of its fields
overrides the field of the default, and ``null`` returns a field to the value it has when no file gives it. The
environment variable ``TREPID_CAR``, which ``--car`` sets, names the folder for this process and those it starts.
Files in folders, such as ``roads/town.yaml``, and rule files replace the default as a whole (:func:`default_file`).
"""

import copy
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.constructor import ConstructorError, RoundTripConstructor
from ruamel.yaml.error import MarkedYAMLError, ReusedAnchorWarning, YAMLError
from ruamel.yaml.scanner import RoundTripScanner, Scanner

from trepid.files.decoding import UndecodableText, decode_text
from trepid.loudness import detail, warn
from trepid.scale import REFERENCE_LANE_M, scale_data
from trepid.spelling import did_you_mean

ROOT = Path(__file__).resolve().parents[1]
"""The checkout, or the folder that the packages are installed in."""
_INSTALLED = ROOT / "trepid" / "defaults"  # where a wheel holds the files of config/
IS_INSTALLED = _INSTALLED.is_dir()  # from a wheel; else a checkout
CONFIG_DIR = _INSTALLED if IS_INSTALLED else ROOT / "config"
EXAMPLES_DIR, DOCS_DIR = ((ROOT / "trepid" if IS_INSTALLED else ROOT) / name for name in ("examples", "docs"))
WORK_DIR = Path() if IS_INSTALLED else ROOT
"""Where benchmarks and trainings write: the checkout, else the working folder."""
CAR = "TREPID_CAR"
_DOCUMENT = re.compile(r"^(?:---|\.\.\.)[ \t]*$", re.MULTILINE)
WHOLE_FILES = frozenset({"fear.yaml"})
"""Files of a car that replace the default as a whole, like those in folders: rules are proved together."""
REFERENCE_FILES = frozenset(
    f"{name}.yaml"
    for name in ("controller", "lead", "perception", "pipelines", "sight", "steer_net", "supervisor", "tape")
)
"""Settings that hold in the reference world of :mod:`trepid.scale`; a car states them in its own metres."""


class Settings(BaseModel):
    """Base of every settings class: frozen, unknown fields and NaN/inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    former_names: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Former names of fields, which set the fields of today, with a warning on stderr."""

    moved_fields: ClassVar[Mapping[str, str]] = {}
    """Fields that stand in another file today, and where: each is refused with its place."""

    @model_validator(mode="before")
    @classmethod
    def _with_former_names(cls, data: Any) -> Any:
        """``data`` with former names replaced; a former name overrides the fields of today."""
        if not isinstance(data, Mapping):
            return data
        for name, place in cls.moved_fields.items():
            if name in data:
                raise wrong_at((name,), f"is now {place}")
        if not cls.former_names:
            return data
        today = {name: value for name, value in data.items() if name not in cls.former_names}
        for former in cls.former_names.keys() & data.keys():
            names = cls.former_names[former]
            warn(f"trepid: warning: the setting {former} is now {' and '.join(names)}")
            for name in names:
                today[name] = _over(today.get(name), data[former])
        return today


BAD_INPUT = 2  # exit code after an InputError; the same input would fail again
INTERRUPTED = 130  # exit code: 128 + SIGINT, as in shells


class InputError(Exception):
    """Wrong input or configuration: one line for the user, exit code 2."""


def refuse(wrong: str, is_so: bool) -> None:
    """Raise InputError with the sentence ``wrong`` if it is so."""
    if is_so:
        raise InputError(wrong)


S = TypeVar("S", bound=BaseModel)


def _over(below: Any, above: Any) -> Any:
    """``above``; for two mappings the fields of both, those of ``above`` first."""
    return {**below, **above} if isinstance(below, Mapping) and isinstance(above, Mapping) else above


def wrong_at(path: Sequence[str | int], message: str) -> PydanticCustomError:
    """An error for validators of a whole model: its place is the part at ``path`` below the model."""
    return PydanticCustomError("wrong_at", "{message}", {"message": message, "path": tuple(path)})


def use_car(folder: Path | None) -> None:
    """Override the defaults by the files in ``folder``, here and in processes started later; None: no car.

    Raises InputError when the folder does not exist or holds a YAML file that overrides nothing.
    """
    if folder is None:
        os.environ.pop(CAR, None)
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; `trepid init {folder} --like sim` creates one")
    known = {path.name for path in CONFIG_DIR.glob("*.yaml")}
    for path in sorted(folder.glob("*.yaml")):
        if path.name not in known:
            raise InputError(f"{path}: overrides no file of the defaults; {did_you_mean(path.name, known)}")
    os.environ[CAR] = str(folder.resolve())


@contextmanager
def using_car(folder: Path | None) -> Iterator[None]:
    """Within the context the car in ``folder`` is in use, then the former one again; None: no change.

    Raises InputError.
    """
    before = os.environ.get(CAR)
    if folder is not None:
        use_car(folder)
    try:
        yield
    finally:
        if folder is not None:
            use_car(None if not before else Path(before))


def car_folder() -> Path | None:
    """Folder of the car that overrides the defaults; None without one."""
    return Path(os.environ[CAR]) if os.environ.get(CAR) else None


def default_file(name: str) -> Path:
    """Path of the file ``name`` that counts as a whole: ``fear.yaml``, or in a folder such as ``roads/town.yaml``.

    The car's file where there is one, else the default.
    """
    car = car_folder()
    return car / name if car is not None and (car / name).exists() else CONFIG_DIR / name


def place_of_edit(path: Path) -> Path:
    """Where an edited copy of the file ``path`` is kept.

    Files of ``config/`` belong to the installation, which no edit changes: the copy goes into the folder of the
    car, else into the working directory, under a free name. Any other file is its own place.
    """
    if CONFIG_DIR.resolve() not in path.resolve().parents:
        return path
    folder = car_folder() or Path.cwd()
    names = (path.name, *(f"{path.stem}-{number}{path.suffix}" for number in range(2, 1000)))
    return next(place for name in names if not (place := folder / name).exists())


def default_names(folder: str) -> list[str]:
    """Names, sorted and without suffix, of the YAML files in ``folder`` of ``config/`` and of the car."""
    tops = [CONFIG_DIR, *filter(None, [car_folder()])]
    return sorted({path.stem for top in tops for path in (top / folder).glob("*.yaml")})


def resource(path: Path) -> Path:
    """The file at ``path`` of a setting: in the folder of the car if it is there, else as shipped."""
    car = car_folder()
    shipped = CONFIG_DIR.joinpath(*path.parts[1:]) if path.parts[:1] == ("config",) else ROOT / path
    return car / path if car is not None and (car / path).exists() else shipped


def load(path: Path, model: type[S], *, overrides: Mapping[str, str] | None = None) -> S:
    """Settings of class ``model`` from the YAML file ``path``; ``overrides`` are dotted.key -> YAML text.

    A file of the defaults is overridden field by field by that of the car. Raises InputError with file:line:column
    when a file is missing, is no YAML, or does not fit ``model``.
    """
    if overrides:
        return parse(read(path), model, source=path, overrides=overrides)
    over = _override_of(path)
    above = (FileText(read_text(over), over), _enlargement(over)) if over is not None else None
    return _load_content(FileText(read_text(path), path), above, model)


@dataclass(frozen=True, slots=True)
class FileText:
    """The text of a file and its place, which only messages state: files with the same text are equal."""

    text: str
    path: Path = field(compare=False)


@lru_cache(maxsize=256)
def _load_content(file: FileText, above: tuple[FileText, float] | None, model: type[S]) -> S:
    """By content, because reading YAML is slow: ten settings files take as long as half a second of driving."""
    data = _mapping(file.text, file.path)
    if above is not None:
        _overlay_file(data, *above)
    return parse(data, model, source=file.path)


def read(path: Path) -> CommentedMap:
    """The YAML mapping in ``path``, overridden by that of the car, with line numbers. Raises InputError."""
    data, over = _mapping(read_text(path), path), _override_of(path)
    if over is not None:
        _overlay_file(data, FileText(read_text(over), over), _enlargement(over))
    return data


def read_first(path: Path, prepare: Callable[[str, Path], str] = lambda text, _: text) -> CommentedMap:
    """The first YAML mapping in ``path``, which others may follow after ``---``. Raises InputError.

    ``prepare``: the YAML of a text in a form of YAML that only one tool writes, with the lines where they are.
    """
    text = prepare(read_text(path), path)
    ends = (mark.start() for mark in _DOCUMENT.finditer(text) if text[: mark.start()].strip())
    return _mapping(text[: next(ends, len(text))], path)


def _override_of(path: Path) -> Path | None:
    """The file of the car that overrides the default at ``path``; None without one."""
    car = car_folder()
    if car is None or path.parent != CONFIG_DIR or path.name in WHOLE_FILES:
        return None
    return car / path.name if (car / path.name).exists() else None


def _enlargement(over: Path) -> float:
    """The factor by which the reference world is larger than that of the car with the file ``over``.

    1 for settings that hold in the world of the car. Raises InputError.
    """
    vehicle = over.parent / "vehicle.yaml"
    if over.name not in REFERENCE_FILES or not vehicle.exists():
        return 1.0
    lane_m = _mapping(read_text(vehicle), vehicle, may_be_empty=True).get("lane_width_m", REFERENCE_LANE_M)
    usable = isinstance(lane_m, float | int) and lane_m > 0  # else the settings of the vehicle report it
    return REFERENCE_LANE_M / lane_m if usable else 1.0


def _overlay_file(data: CommentedMap, over: FileText, enlargement: float) -> None:
    """Override the fields of ``data`` by those in ``over``, in the reference world."""
    above = _mapping(over.text, over.path, may_be_empty=True)
    if enlargement != 1.0:
        scale_data(above, enlargement)
    overlay(data, above, over.path)


def overlay(data: CommentedMap, over: CommentedMap, source: Path) -> None:
    """Override the fields of ``data`` by those of ``over``, which was read from ``source``; null removes one.

    The places of the fields, and the file each comes from, follow along for error messages.
    """
    for key, value in over.items():
        if isinstance(value, CommentedMap) and isinstance(data.get(key), CommentedMap):
            overlay(data[key], value, source)
        elif value is None:
            data.pop(key, None)
        else:
            data[key] = value
            data.lc.add_kv_line_col(key, _position_of(over, key))
            vars(data).setdefault("sources", {})[key] = source


def _position_of(data: CommentedMap, key: Any) -> list[int] | None:
    """Line and column, from 0, of the name ``key`` and its value; None for a field that is from no file.

    ``key`` may also be in a mapping that ``<<`` merges into ``data``.
    """
    own: list[int] | None = (data.lc.data or {}).get(key)
    merged = (_position_of(below, key) for below in data.merge if key in below)
    return own or next(merged, None)


def texts(path: Path) -> tuple[str, ...]:
    """The text in ``path`` and, where there is one, that of the file of the car above it. Raises InputError."""
    over = _override_of(path)
    return read_text(path), *([read_text(over)] if over is not None else [])


def read_text(path: Path, *, windows: bool = False, broken_bytes: bool = False) -> str:
    """The text in ``path`` in any of the encodings of :mod:`trepid.files.decoding`. Raises InputError.

    For ``windows`` and ``broken_bytes`` see :func:`trepid.files.decoding.decode_text`.
    """
    detail(f"trepid: reads {path}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {_brief(error)}") from error
    try:
        text = decode_text(data, windows=windows, broken_bytes=broken_bytes)
    except UndecodableText as error:
        raise InputError(f"{path}:{error.line}:{error.column}: {error.problem}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


_YAML_IN_WORDS = {
    "'\\t'": "a tab; write spaces",
    "expected <block end>": "wrong indentation; entries of one list or block begin in the same column",
    "expected '<document start>'": "wrong indentation; entries of one list or block begin in the same column",
    "expected escape sequence": "a backslash in double quotes, as in paths of Windows: write '...' or C:/...",
    "found unknown escape": "a backslash in double quotes, as in paths of Windows: write '...' or C:/...",
    "mapping values are not allowed": "wrong indentation, or a text with a colon that needs quotes",
}
"""Part of a message of the YAML reader -> what to mend."""
_TABS, _SIGNS = re.compile(r"(\t[ \t]*)([#\r\n\0])?"), (":", "-", ",", "?")


def _mapping(text: str, path: Path, *, may_be_empty: bool = False) -> CommentedMap:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ReusedAnchorWarning)  # YAML takes the last one
            yaml = YAML(typ="rt")
            yaml.Scanner = _PlainScanner
            yaml.Constructor = _PlainConstructor
            data = yaml.load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else f"{path}"
        problem = (error.problem or error.context or "not valid YAML").splitlines()[0]
        problem = next((words for found, words in _YAML_IN_WORDS.items() if found in problem), problem)
        raise InputError(f"{where}: not valid YAML: {problem}") from error
    except (YAMLError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not valid YAML: {_brief(error)}") from error
    except RecursionError as error:
        raise InputError(f"{path}: nested too deeply") from error
    if data is None and may_be_empty:  # nothing but comments
        return CommentedMap()
    if not isinstance(data, CommentedMap):
        raise InputError(f"{path}:1:1: expected a mapping of names to values")
    return data


class _PlainScanner(Scanner):
    """Passes over tabs between a sign and its value, and at the end of a line, as YAML allows.

    ruamel refuses them in blocks (YAML 1.2.2, section 6.2). Comments are not gathered, which takes as long as all
    else.
    """

    def scan_to_next_token(self) -> Any:
        comment, reader = super().scan_to_next_token(), self.reader
        tabs = None if comment else _TABS.match(reader.buffer, reader.pointer)
        if tabs and (tabs[2] or reader.buffer[: reader.pointer].rstrip(" ").endswith(_SIGNS)):
            reader.forward(len(tabs[1]))
            return self.scan_to_next_token()
        return comment


class _EditingScanner(_PlainScanner, RoundTripScanner):
    """The same with comments."""


def editing_yaml() -> YAML:
    """A reader and writer of YAML that keeps comments, and reads what the settings read."""
    yaml = YAML(typ="rt")
    yaml.Scanner = _EditingScanner
    return yaml


class _PlainConstructor(RoundTripConstructor):
    """Refuses tags such as ``!!set`` and names that are lists or mappings.

    Settings have no use for them, and wrong ones are exceptions of other types in the library.
    """

    def construct_non_recursive_object(self, node: Any, tag: str | None = None) -> Any:
        name = str(node.tag).removeprefix("tag:yaml.org,2002:")
        if node.ctag.handle is not None or name not in _PLAIN_TAGS[node.id]:
            raise ConstructorError(None, None, f"unknown tag {node.tag}", node.start_mark)
        for key, _ in node.value if node.id == "mapping" else ():
            if key.id != "scalar":
                raise ConstructorError(None, None, f"a {key.id} cannot name a value", key.start_mark)
        return super().construct_non_recursive_object(node, tag)


_PLAIN_TAGS = {
    "scalar": ("str", "int", "float", "bool", "null", "timestamp", "merge"),
    "sequence": ("seq",),
    "mapping": ("map",),
}


def parse(
    data: CommentedMap, model: type[S], *, source: Path | str, overrides: Mapping[str, str] | None = None
) -> S:
    """Settings of class ``model`` from YAML ``data`` read from ``source``. Raises InputError."""
    for key, text in (overrides or {}).items():
        _put_text(data, key, text)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problem = _first(error)
        wants_list = problem["type"] in ("tuple_type", "list_type")
        key = ".".join(map(str, _without_tags(problem["loc"], data)))
        if wants_list and overrides and key in overrides:  # a,b or one item, without brackets
            return parse(data, model, source=source, overrides={**overrides, key: f"[{overrides[key]}]"})
        place = _where(problem["loc"], data, source, overrides)
        raise InputError(f"{place}: {complaint(error, data, model)}") from error


def _put_text(data: CommentedMap, key: str, text: str) -> None:
    """Set the field ``key`` to the value of ``text`` as YAML. Raises InputError."""
    try:
        put(data, key, YAML(typ="safe").load(text))
    except LookupError as error:
        raise InputError(f"--set {key}: {error.args[0]}") from error
    except (YAMLError, ValueError) as error:
        raise InputError(f"--set {key}={text}: not valid YAML") from error


def parse_overrides(texts: Sequence[str]) -> dict[str, str]:
    """The ``KEY=VALUE`` texts of ``--set`` as a mapping. Raises InputError."""
    overrides = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not key or not sign:
            raise InputError(f"--set {text}: expected KEY=VALUE")
        overrides[key] = value
    return overrides


def json_schema(model: type[BaseModel], title: str) -> str:
    """The JSON schema (draft 2020-12) of files for ``model``, which editors use; text with a final newline."""
    draft = "https://json-schema.org/draft/2020-12/schema"
    schema = {"$schema": draft, **model.model_json_schema(), "title": title}
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def put(data: Any, dotted: str, value: object) -> None:
    """Set the field ``dotted`` of mappings and lists, such as ``faults.0.from_s``; missing mappings are created.

    Raises LookupError for a list item that does not exist, and below a value that is neither mapping nor list.
    """
    *parents, name = dotted.split(".")
    place = data
    for parent in parents:
        key = _key(place, parent)
        below = place[key] if _has(place, key) else None
        # Copied, because an alias in the file puts one mapping in several places.
        place[key] = copy.deepcopy(below) if isinstance(below, dict | list) else CommentedMap()
        place = place[key]
    place[_key(place, name)] = value


def _key(place: Any, part: str) -> Any:
    """``part`` of a dotted name as a key of the mapping or the index into the list ``place``."""
    if isinstance(place, dict):
        return part
    if not part.isdecimal() or int(part) >= len(place):
        raise LookupError(f"no item {part!r} in a list of {len(place)}, counted from 0")
    return int(part)


def fault_line(
    path: Sequence[str | int],
    what: str,
    data: CommentedMap,
    source: Path | str,
    overrides: Mapping[str, str] | None = None,
) -> str:
    """One line with the place of the field at ``path`` and its fault ``what``."""
    return f"{_where(path, data, source, overrides)}: {'.'.join(map(str, path))}: {what}"


def _where(
    path: Sequence[str | int], data: CommentedMap, source: Path | str, overrides: Mapping[str, str] | None
) -> str:
    """Place of a field in the file or on the command line."""
    dotted = ".".join(map(str, _without_tags(path, data)))
    given = next((key for key in overrides or () if f"{dotted}.".startswith(f"{key}.")), None)
    return f"--set {given}" if given else place(data, path, source)


def place(data: Any, path: Sequence[str | int], source: Path | str) -> str:
    """``file:line:column`` of the deepest part of ``path`` that exists; ``source`` is the file of ``data``."""
    line, column = position(data, path)
    for part in path:
        if not _has(data, part):
            continue
        source = getattr(data, "sources", {}).get(part, source)
        data = data[part]
    return f"{source}:{line}:{column}"


_QUOTED = re.compile(r"'([^']*)'")


def complaint(error: ValidationError, data: object, model: type[BaseModel]) -> str:
    """The first problem of ``error`` about ``data`` in one line, without its place."""
    problem = _first(error)
    path = _without_tags(problem["loc"], data)
    dotted = ".".join(map(str, path))
    if problem["type"] == "extra_forbidden":
        known = _field_names(model, problem["loc"][:-1])
        return f"unknown field {dotted!r}; {did_you_mean(str(path[-1]), known)}"
    if problem["type"] == "missing":
        return f"{'.'.join(map(str, [*path, problem['loc'][-1]]))!r} is missing"
    if problem["type"] in ("literal_error", "enum") and isinstance(problem["input"], str):
        known = _QUOTED.findall(problem["ctx"]["expected"])
        return f"{dotted}: unknown value {problem['input']!r}; {did_you_mean(problem['input'], known)}"
    what = " ".join(problem["msg"].removeprefix("Value error, ").split())
    return f"{dotted}: {what}" if dotted else what


def _first(error: ValidationError) -> Any:
    """The problem to report: a misspelt field comes before the field that is missing because of it."""
    problem = min(error.errors(), key=lambda found: found["type"] != "extra_forbidden")
    further = problem["ctx"]["path"] if problem["type"] == "wrong_at" else ()
    return {**problem, "loc": (*problem["loc"], *further)}


def _without_tags(path: Sequence[str | int], data: object) -> list[str | int]:
    """The parts of ``path`` that exist in the data: pydantic adds the names of union members."""
    kept: list[str | int] = []
    for part in path:
        if _has(data, part):
            data = data[part]  # type: ignore[index]
            kept.append(part)
    return kept


def _has(data: object, part: str | int) -> bool:
    if isinstance(data, dict):
        return part in data
    return isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)


def position(data: Any, path: Sequence[str | int]) -> tuple[int, int]:
    """Line and column, from 1, of the deepest part of ``path`` that exists in the file."""
    line, column = 1, 1
    for part in path:
        if not _has(data, part):
            continue  # the name of a union member, or a field that is missing
        try:
            found = _position_of(data, part) if isinstance(data, CommentedMap) else data.lc.item(part)
        except (KeyError, TypeError, AttributeError):
            found = None
        if found is None:
            break  # from the command line: no place in the file
        line, column = found[0] + 1, found[1] + 1
        data = data[part]
    return line, column


def _field_names(model: type[BaseModel], path: Sequence[str | int]) -> list[str]:
    """Names of the fields of the model at ``path`` below ``model``, or of the last model that ``path`` reaches."""
    models = [model]
    for part in path:
        holders = [m for m in models if part in m.model_fields]
        if holders:
            models = _models(holders[0].model_fields[str(part)].annotation) or models
        else:  # the index of an item, or the tag of a union member
            models = [m for m in models if _is_tagged(m, part)] or models
    return sorted({field.alias or name for found in models for name, field in found.model_fields.items()})


def _models(annotation: object) -> list[type[BaseModel]]:
    """Every model named in a type such as ``tuple[A | B, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


def _is_tagged(model: type[BaseModel], tag: str | int) -> bool:
    fields = model.model_fields.values()
    return tag == model.__name__ or any(tag in get_args(field.annotation) for field in fields)


def _brief(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).splitlines()[0]
