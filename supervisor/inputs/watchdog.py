"""Detection of lost senders. A sender without any message so far is not lost: the supervisor does not start yet."""

import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

from supervisor.inputs.validation import ValidationSettings
from trepid.causes import Cause
from trepid.messages import VehicleState

STATISTICS, LEAD, USERS, STATE = "statistics", "lead", "road_users", "state"
"""Names of the inputs besides the estimators."""
_SILENT = {
    STATISTICS: Cause.IMAGE_STATISTICS_LOST,
    LEAD: Cause.LEAD_LOST,
    USERS: Cause.ROAD_USERS_LOST,
}
FAULTS = frozenset(
    {
        *(Cause.STALE_DATA, Cause.LOST_ESTIMATOR, Cause.VEHICLE_STATE_LOST),
        *(*_SILENT.values(), Cause.LOST_PROCESS, Cause.STOP_BUTTON, Cause.DRIVER_OVERRIDE),
    }
)
"""Causes of a :class:`Fault`."""


class Fault(NamedTuple):
    """Cause of an immediate stop, and whether a process is lost, which makes the stop final."""

    cause: str  # "" for none
    lost: bool
    part: str = ""  # the lost estimators


class Watchdog:
    """Holds when each sender sent its newest usable message; a sender without any cannot be lost."""

    def __init__(self, limits: ValidationSettings, *, frames_s: float) -> None:
        """No frames for longer than ``frames_s`` from any estimator are a fault."""
        self._limits, self._frames_s = limits, frames_s
        self._heard_s: dict[str, float] = {}

    def step(
        self,
        estimator_ages_s: Mapping[str, float],
        *,
        statistics_s: float,
        lead_s: float | None,
        road_users_s: float | None = None,
        state_s: float,
        state: VehicleState | None,
        now_s: float,
        process_lost: bool = False,
    ) -> Fault:
        """The worst fault by these ages (inf: no message, or none with a possible time), a common cause first.

        ``lead_s`` is None where no lead detector runs, ``road_users_s`` where none of people. ``process_lost``: the
        launcher reports a lost process. In ``state`` a person may stop or steer the car.
        """
        ages = {**estimator_ages_s, STATISTICS: statistics_s, STATE: state_s}
        for name, age_s in ((LEAD, lead_s), (USERS, road_users_s)):
            if age_s is None:
                self._heard_s.pop(name, None)
            else:
                ages[name] = age_s
        for name, age in ages.items():
            if age <= self._limits.fresh_s or (name in self._heard_s and math.isfinite(age)):
                self._heard_s[name] = now_s - age
        lost = {name for name, sent_s in self._heard_s.items() if now_s - sent_s > self._limits.lost_s}
        estimators = self._heard_s.keys() & estimator_ages_s.keys()
        cause: str = ""
        if estimators and min(estimator_ages_s.values()) > self._frames_s:
            cause = Cause.STALE_DATA
        elif lost & estimators:
            cause = Cause.LOST_ESTIMATOR
        elif STATE in self._heard_s and state_s > self._limits.state_fresh_s:
            cause = Cause.VEHICLE_STATE_LOST
        elif silent := [of for name, of in _SILENT.items() if name in lost]:
            cause = silent[0]
        elif process_lost:
            cause = Cause.LOST_PROCESS
        elif state is not None and state.stop_pressed:
            cause = Cause.STOP_BUTTON
        elif state is not None and state.driver_override:
            cause = Cause.DRIVER_OVERRIDE
        part = ", ".join(sorted(lost & estimators)) if cause == Cause.LOST_ESTIMATOR else ""
        return Fault(cause, bool(lost) or process_lost, part)


def cause_of_lateness(late: Collection[str], estimators: Collection[str]) -> Cause:
    """The common cause of late messages: no frames where every estimator is late, else the first that is; NONE."""
    missing = [name for name in estimators if name in late]
    if missing:
        return Cause.STALE_DATA if len(missing) == len(estimators) else Cause.LOST_ESTIMATOR
    if STATISTICS in late:
        return Cause.IMAGE_STATISTICS_LOST
    return Cause.LEAD_LOST if LEAD in late else Cause.NONE
