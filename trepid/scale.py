"""Scale: a small car on narrow lanes is the road car in a world that is smaller by one factor.

A camera image has no scale. With every length divided by s and times unchanged, the images, angles and times of a
car on lanes of width s·:data:`REFERENCE_LANE_M` are those of a car on public roads. Perception, supervisor and
controller compute with lengths of that reference world, in which all their settings hold; their inputs are divided
and their outputs multiplied by s^p, where p is the power of the metre in the unit that ends a name:

=====================================  ====
``_m``, ``_mps``, ``_mps2``, ``_mps3``   1
``_1pm``, ``_radpm``                    -1
``_1pm2``                               -2
``rad_per_mps2``                        -1
``_m_per_sqrt_m``                       1/2
=====================================  ====

Barenblatt, Scaling (2003), chapter 2. A factor of 1 changes no bit: every function returns its input itself.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache
from typing import Any, TypeVar, cast

from pydantic import BaseModel
from ruamel.yaml.comments import CommentedMap

REFERENCE_LANE_M = 3.3
"""Width of the lanes of the reference world: two lanes of a rural road. The settings in config/ hold there."""
PUBLIC_LANE_M = 2.0
"""Narrower lanes are those of models: no public road has them."""

_POWERS = {
    "m": 1.0,
    "m2": 2.0,
    "mps": 1.0,
    "mps2": 1.0,
    "mps3": 1.0,
    "1pm": -1.0,
    "1pm2": -2.0,
    "radpm": -1.0,
}
_DIVISORS = {"m": 1.0, "sqrt_m": 0.5, "mps2": 1.0, "s": 0.0, "sqrt_s": 0.0}
_UNITS = frozenset({*_POWERS, "rad", "s", "1ps", "radps", "px", "deg", "grey", "ratio"})

T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)


@cache
def power_of_metre(name: str) -> float:
    """The power of the metre in the unit that ends ``name``; 0 for a name without a unit."""
    stem, per, divisor = name.partition("_per_")
    unit = stem.rsplit("_", 1)[-1]
    if per and (divisor not in _DIVISORS or unit not in _UNITS):
        return 0.0
    return _POWERS.get(unit, 0.0) - (_DIVISORS[divisor] if per else 0.0)


def scaled_message(message: T, factor: float) -> T:
    """``message``, a dataclass, in a world that is ``factor`` times larger; None stays None."""
    if factor == 1.0 or message is None:
        return message
    changes = {}
    for name, power in _powers_of(cast(Any, type(message))):
        value = getattr(message, name)
        if isinstance(value, tuple):
            changes[name] = tuple(item * factor**power for item in value)
        elif value is not None:
            changes[name] = value * factor**power
    return replace(message, **changes)  # type: ignore[type-var]


class ReferenceWorld:
    """Messages of a car on lanes ``scale`` times as wide as the reference lane, in the reference world and back."""

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._newest: dict[str, tuple[Any, Any]] = {}  # newest message and its enlargement, by input

    def enlarge(self, name: str, message: T) -> T:
        """``message`` of the input ``name`` in the reference world.

        The same message gives the same object, because the steps compare objects to recognise a new message.
        """
        if self._scale == 1.0:
            return message
        newest, enlarged = self._newest.get(name, (None, None))
        if newest is not message:
            enlarged = scaled_message(message, 1 / self._scale)
            self._newest[name] = message, enlarged
        return cast(T, enlarged)

    def restore(self, message: T) -> T:
        """``message`` of the reference world in the world of the car."""
        return scaled_message(message, self._scale)


@cache
def _powers_of(kind: Any) -> tuple[tuple[str, float], ...]:
    return tuple((field.name, power) for field in fields(kind) if (power := power_of_metre(field.name)))


def scaled_settings(settings: M, factor: float, *, given_only: bool = False) -> M:
    """``settings``, and those within, in a world that is ``factor`` times larger; unchecked.

    ``given_only``: fields that were left out keep their defaults, which then hold in the larger world.
    """
    if factor == 1.0:
        return settings
    names = settings.model_fields_set if given_only else type(settings).model_fields
    update = {name: _scale_value(name, getattr(settings, name), factor, given_only) for name in names}
    return settings.model_copy(update=update)


def given_fields(settings: BaseModel) -> dict[str, Any]:
    """The fields of ``settings`` that were given, not left to their defaults."""
    return {name: getattr(settings, name) for name in settings.model_fields_set}


def _scale_value(name: str, value: Any, factor: float, given_only: bool) -> Any:
    if isinstance(value, BaseModel):
        return scaled_settings(value, factor, given_only=given_only)
    if isinstance(value, tuple):
        return tuple(_scale_value(name, item, factor, given_only) for item in value)
    if isinstance(value, float | int) and not isinstance(value, bool):
        return value * factor**power if (power := power_of_metre(name)) else value
    return value


def scale_data(data: Any, factor: float, done: set[int] | None = None) -> None:
    """Scale the numbers of the YAML ``data`` in place, as :func:`scaled_settings`.

    ``done``: identities of the mappings and lists that are scaled already, because an alias names them again.
    """
    done = set() if done is None else done
    if not isinstance(data, Mapping) or id(data) in done:
        return
    assert isinstance(data, CommentedMap)
    done.add(id(data))
    for name, value in data.items():
        if isinstance(value, Mapping):
            scale_data(value, factor, done)
        elif not isinstance(value, list):
            data[name] = _scale_value(str(name), value, factor, False)
        elif id(value) not in done:
            done.add(id(value))
            for number, item in enumerate(_scale_value(str(name), tuple(value), factor, False)):
                value[number] = item
                scale_data(item, factor, done)
