"""Parts that other packages add through entry points: verbs, estimators, cameras, actuators, plants, worlds, inputs
of fear, processes.

A package declares, for example::

    [project.entry-points."trepid.cameras"]
    thermal = "my_package.cameras:Thermal"
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from trepid.config import InputError
from trepid.spelling import did_you_mean


class Group(StrEnum):
    """Groups of entry points."""

    VERBS = "trepid.verbs"
    ESTIMATORS = "trepid.estimators"
    CAMERAS = "trepid.cameras"
    ACTUATORS = "trepid.actuators"
    PLANTS = "trepid.plants"
    WORLDS = "trepid.worlds"
    FEAR_INPUTS = "trepid.fear_inputs"
    PROCESSES = "trepid.processes"


@cache
def added_entry_points(group: Group) -> Mapping[str, EntryPoint]:
    """The entry points of ``group`` by name. Raises InputError when two packages add the same name."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise InputError(f"{group} {point.name!r} is added twice, as {other.value} and as {point.value}")
    return found


def names(group: Group, own: Mapping[str, Any]) -> list[str]:
    """Names of the parts of ``group``: those of Trepid, ``own``, then those of other packages."""
    return [*own, *(name for name in added_entry_points(group) if name not in own)]


def part(group: Group, name: str, own: Mapping[str, Callable[..., Any]]) -> Callable[..., Any]:
    """The part called ``name``: one of Trepid's ``own``, else the object of an entry point of ``group``.

    Raises InputError for an unknown name, and when the package of the entry point cannot be imported.
    """
    if name in own:
        return own[name]
    point = added_entry_points(group).get(name)
    if point is None:
        hint = did_you_mean(name, names(group, own))
        raise InputError(f"{group.removeprefix('trepid.')}: unknown name {name!r}; {hint}")
    try:
        return point.load()
    except Exception as error:  # an import runs the code of the package
        problem = f"cannot be imported: {type(error).__name__}: {error}"
        raise InputError(f"{group} {name!r} = {point.value}: {problem}") from error


@contextmanager
def beginning(group: Group, name: str) -> Iterator[None]:
    """Raise InputError where a part of another package cannot begin; errors of Trepid's own parts stay."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # it runs the code of the package
        if name not in added_entry_points(group):
            raise
        raise InputError(f"{group} {name!r}: cannot begin: {type(error).__name__}: {error}") from error


def package_of(group: Group, name: str) -> str:
    """The package that adds the part ``name``; "" for a part of Trepid and for an unknown one."""
    point = added_entry_points(group).get(name)
    if point is None:
        return ""
    return point.dist.name if point.dist is not None else point.module.partition(".")[0]
