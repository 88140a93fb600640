"""Differences between recorded messages and those of a replay, bit by bit."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from trepid.wire import from_cdr, to_cdr

MEASURED = frozenset({"latency_ms"})
"""Fields that state a duration of the drive and are no result of a step."""
WATCHED = {
    "supervisor/decision": ("fear", "speed_cap_mps"),
    "controller/command": ("road_wheel_angle_rad", "accel_mps2"),
}
"""Key of a topic -> the fields whose greatest change is of interest."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that differs."""

    t_s: float  # from the start of the drive
    topic: str
    field: str
    recorded: Any
    replayed: Any

    def row(self) -> dict[str, Any]:
        """For JSON; numbers that are not finite are null."""
        return {
            "t_s": round(self.t_s, 6),
            "topic": self.topic,
            "field": self.field,
            "recorded": _plain(self.recorded),
            "replayed": _plain(self.replayed),
        }


@dataclass(slots=True)
class Comparison:
    """What differs on one topic so far."""

    topic: str
    compared: int = 0
    different: int = 0
    first: Difference | None = None
    greatest: dict[str, Difference] = field(default_factory=dict)  # by field of WATCHED
    modes: list[Difference] = field(default_factory=list)  # where the mode begins to differ
    _modes: tuple[Any, Any] | None = None

    def add(self, t_s: float, recorded: Any, replayed: Any) -> None:
        """Compare a message of ``t_s`` with that of the replay, both as they are recorded."""
        self.compared += 1
        found = list(differences(recorded, replayed))
        if found:  # the wire may account for them
            found = list(differences(recorded, as_read(replayed)))
        if found:
            self.different += 1
            name, was, now = found[0]
            self.first = self.first or Difference(t_s, self.topic, name, was, now)
        for name, was, now in found:
            if name in WATCHED.get(self.topic, ()):
                self._keep_greatest(Difference(t_s, self.topic, name, was, now))
        modes = next(((was, now) for name, was, now in found if name == "mode"), None)
        if modes is not None and modes != self._modes:
            self.modes.append(Difference(t_s, self.topic, "mode", *modes))
        self._modes = modes

    def _keep_greatest(self, found: Difference) -> None:
        before = self.greatest.get(found.field)
        if before is None or _size(found) > _size(before):
            self.greatest[found.field] = found


def as_read(message: Any) -> Any:
    """``message`` after the way over the wire, which holds a command with 32 bits a number."""
    return from_cdr(to_cdr(message), type(message))


def differences(recorded: Any, replayed: Any) -> Iterator[tuple[str, Any, Any]]:
    """Name and both values of each field that differs; NaN equals NaN."""
    if recorded == replayed:
        return
    for one in fields(recorded):
        was, now = getattr(recorded, one.name), getattr(replayed, one.name)
        if one.name not in MEASURED and not _same(was, now):
            yield one.name, was, now


def _same(one: Any, other: Any) -> bool:
    if one == other and type(one) is type(other):
        return True
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    both = isinstance(one, float) and isinstance(other, float)
    return bool(one == other or (both and math.isnan(one) and math.isnan(other)))


def _size(found: Difference) -> float:
    """Size of the change of a number; infinite where one is missing."""
    if isinstance(found.recorded, float) and isinstance(found.replayed, float):
        return abs(found.replayed - found.recorded)
    return math.inf


def _plain(value: Any) -> Any:
    """``value`` for JSON."""
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
