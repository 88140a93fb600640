"""What a recording states about its drive: the notes of its metadata record, and the times of lock-step runs.

Stamps of messages are whole nanoseconds from 1970 on, and cannot be negative. The time of a lock-step run is
k·``period_s`` and negative in the run-up, so its recording adds the start of the drive to all times. :class:`Times`
inverts that exactly, so that a replay gives each step the very numbers that the run gave it.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from trepid.config import InputError

WHAT, ESTIMATORS, CRUISE, PERIOD = "what", "estimators", "cruise_speed_mps", "lockstep_period_s"
NETWORKS = "networks"
RULES_FROM_S, RULES = "rules_from_s", "rules"
"""Values of the heartbeat about changed rules: the time after which they apply, and their text."""
_TIMES = ("t_s", "decided_s", "path_t_s")  # of any message
_ON_GRID = 1e-6  # of a period; a stamp is rounded by less


def drive_notes(
    *,
    what: str,
    estimators: Iterable[str],
    cruise_speed_mps: float | None,
    lockstep_period_s: float | None = None,
    networks: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The notes of a drive: name of the scenario, estimators, cruise speed (None: that of the settings).

    ``lockstep_period_s``: period of a lock-step run; None: a live drive. ``networks``: files of driving networks by
    name, of which place and hash are noted. Raises InputError for one that cannot be read.
    """
    numbers = {CRUISE: cruise_speed_mps, PERIOD: lockstep_period_s}
    known = {name: repr(number) for name, number in numbers.items() if number is not None}
    if networks:
        held = {name: (str(Path(file).resolve()), hash_of(Path(file))) for name, file in networks.items()}
        known[NETWORKS] = json.dumps(held)
    return {WHAT: what, ESTIMATORS: ",".join(estimators), **known}


def networks_of(notes: Mapping[str, str]) -> dict[str, tuple[Path, str]]:
    """File and hash of each driving network of a drive, by name. Raises InputError for other text."""
    try:
        held = json.loads(notes.get(NETWORKS, "{}"))
        return {str(name): (Path(file), str(sha256)) for name, (file, sha256) in held.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(
            f"the recording notes {NETWORKS}: {notes[NETWORKS]!r}, which is no list of them"
        ) from error


def hash_of(file: Path) -> str:
    """SHA-256 of a file. Raises InputError."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error


def number(notes: Mapping[str, str], name: str) -> float | None:
    """The number ``name`` of the notes; None without one. Raises InputError for other text."""
    try:
        return float(notes[name]) if name in notes else None
    except ValueError as error:
        raise InputError(f"the recording notes {name}: {notes[name]!r}, which is no number") from error


class Times:
    """Times of a recording and of the nodes that were recorded; the same in a live drive."""

    def __init__(self, *, began_s: float = 0.0, period_s: float | None = None) -> None:
        """``period_s`` None: a live drive."""
        self._began_s, self._period_s = began_s, period_s

    def node_s(self, t_s: float) -> float:
        """The time of a node at the recorded time ``t_s``."""
        if self._period_s is None:
            return t_s
        ticks = (t_s - self._began_s) / self._period_s
        whole = round(ticks)
        return whole * self._period_s if abs(ticks - whole) < _ON_GRID else t_s - self._began_s

    def recorded_time_s(self, node_s: float) -> float:
        """The recorded time at the time ``node_s`` of a node."""
        return node_s if self._period_s is None else self._began_s + node_s

    def of_node(self, message: Any) -> Any:
        """The recorded ``message`` as the nodes had it."""
        return message if self._period_s is None else _shift_times(message, self.node_s)

    def in_recorded_time(self, message: Any) -> Any:
        """The ``message`` of a node as it is recorded."""
        return message if self._period_s is None else _shift_times(message, self.recorded_time_s)


def _shift_times(message: Any, shift: Any) -> Any:
    """``message`` with each of its times replaced by ``shift`` of it."""
    times_s = {name: getattr(message, name, None) for name in _TIMES}
    return replace(message, **{name: shift(t_s) for name, t_s in times_s.items() if t_s is not None})
