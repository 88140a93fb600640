"""YAML files to frozen, validated settings; an error says file:line:column, what, and what was expected."""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

ROOT = Path(__file__).resolve().parents[1]
CONFIG_DIR = ROOT / "config"


class Settings(BaseModel):
    """Base of every settings class: frozen, unknown fields and NaN/inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class InputError(Exception):
    """The user's input or configuration is wrong: one line for them, exit code 2."""


S = TypeVar("S", bound=BaseModel)


def load(path: Path, model: type[S], *, overrides: Mapping[str, str] | None = None) -> S:
    """Settings of class ``model`` from the YAML file ``path``; ``overrides`` are dotted.key -> YAML text.

    Raises InputError with file:line:column when the file is missing, is no YAML, or does not fit ``model``.
    """
    return parse(read(path), model, source=path, overrides=overrides)


def read(path: Path) -> CommentedMap:
    """The YAML mapping in ``path`` with its line numbers. Raises InputError."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {_brief(error)}") from error
    try:
        data = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else f"{path}"
        problem = (error.problem or error.context or "not valid YAML").splitlines()[0]
        raise InputError(f"{where}: not valid YAML: {problem}") from error
    except (YAMLError, ValueError) as error:
        raise InputError(f"{path}: not valid YAML: {_brief(error)}") from error
    if not isinstance(data, CommentedMap):
        raise InputError(f"{path}:1:1: expected a mapping of names to values")
    return data


def parse(
    data: CommentedMap, model: type[S], *, source: Path | str, overrides: Mapping[str, str] | None = None
) -> S:
    """Settings of class ``model`` from YAML ``data`` read from ``source``. Raises InputError."""
    for key, text in (overrides or {}).items():
        _override(data, key, text, model)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(_explain(error, data, model, source, overrides or {})) from error


def parse_overrides(texts: Sequence[str]) -> dict[str, str]:
    """``KEY=VALUE`` texts of ``--set`` as a mapping. Raises InputError."""
    overrides = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not key or not sign:
            raise InputError(f"--set {text}: expected KEY=VALUE")
        overrides[key] = value
    return overrides


def _override(data: CommentedMap, key: str, text: str, model: type[BaseModel]) -> None:
    *parents, name = key.split(".")
    place: Any = data
    for parent in parents:
        if not isinstance(place, dict):
            raise InputError(f"--set {key}: {parent} has nothing below it")
        if not isinstance(place.get(parent), dict):
            place[parent] = CommentedMap()
        place = place[parent]
    try:
        place[name] = YAML(typ="safe").load(text)
    except YAMLError as error:
        raise InputError(f"--set {key}={text}: not valid YAML") from error


def _explain(
    error: ValidationError,
    data: CommentedMap,
    model: type[BaseModel],
    source: Path | str,
    overrides: Mapping[str, str],
) -> str:
    """The first problem of ``error`` as one line."""
    # A misspelt field is reported before the field that is missing because of it.
    problem = min(error.errors(), key=lambda found: found["type"] != "extra_forbidden")
    path: Sequence[str | int] = problem["loc"]
    dotted = ".".join(map(str, path))
    line, column = position(data, path)
    where = f"--set {dotted}" if dotted in overrides else f"{source}:{line}:{column}"
    what = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        known = _field_names(model, path[:-1])
        close = difflib.get_close_matches(str(path[-1]), known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"
        return f"{where}: unknown field {dotted!r}; {hint}"
    if problem["type"] == "missing":
        return f"{where}: {dotted!r} is missing"
    return f"{where}: {dotted}: {what}" if dotted else f"{where}: {what}"


def position(data: Any, path: Sequence[str | int]) -> tuple[int, int]:
    """Line and column, from 1, of the deepest part of ``path`` that stands in the file."""
    line, column = 1, 1
    for part in path:
        try:
            if isinstance(data, CommentedMap) and part in data:
                line, column = (n + 1 for n in data.lc.key(part))
            elif isinstance(data, CommentedSeq) and isinstance(part, int) and part < len(data):
                line, column = (n + 1 for n in data.lc.item(part))
            else:
                break  # e.g. the name of a union member, which is not in the file
        except (KeyError, TypeError, AttributeError):
            break  # set from the command line: it has no place in the file
        data = data[part]
    return line, column


def _field_names(model: type[BaseModel], path: Sequence[str | int]) -> list[str]:
    """Field names of the model at ``path`` below ``model``, as far as it can be followed."""
    for part in path:
        field = model.model_fields.get(str(part))
        annotation = field.annotation if field else None
        for inner in (annotation, *get_args(annotation)):  # a model, or a dict or list of models
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                model = inner
    return sorted(model.model_fields)


def _brief(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).splitlines()[0]
