"""Scores of a drive of a real car, where the true lane is not known."""

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from drive.course import Verdict
from trepid.messages import Decision, SimTruth, VehicleState

if TYPE_CHECKING:
    from drive.log import DriveLog

LONGEST_S = 1.0  # a longer gap between two states is not counted as driven


class Tally:
    """Sums over the states of the vehicle; their size does not grow with the drive. The judge of a real car."""

    def __init__(self) -> None:
        self._last: VehicleState | None = None
        self._duration_s = self._measured_s = self._distance_m = self._feared_s = self._fear_s = 0.0
        self._max_fear: float | None = None
        self._modes: defaultdict[str, float] = defaultdict(float)
        self._causes: defaultdict[str, float] = defaultdict(float)

    def add(self, message: SimTruth | VehicleState, log: "DriveLog") -> None:
        """Count the time since the last state of the vehicle for this one."""
        if isinstance(message, VehicleState):
            self._count(message, log.decision)

    def verdict(self, problems: Sequence[str], *, elapsed_s: float) -> Verdict:
        """The sums; nothing but ``problems`` fails a drive without a true lane."""
        return Verdict([*problems], self.row())

    def _count(self, state: VehicleState, decision: Decision | None) -> None:
        last, self._last = self._last, state
        held_s = 0.0 if last is None else state.t_s - last.t_s
        if not 0.0 < held_s <= LONGEST_S:
            return
        self._duration_s += held_s
        if state.speed_mps is not None:
            self._measured_s += held_s
            self._distance_m += abs(state.speed_mps) * held_s
        if decision is not None:
            self._feared_s += held_s
            self._fear_s += decision.fear * held_s
            self._max_fear = max(self._max_fear or 0.0, decision.fear)
            self._modes[str(decision.mode)] += held_s
            self._causes[str(decision.cause)] += held_s

    def row(self) -> dict[str, Any]:
        """The fields of a simulated drive, in their order; None for those that need the true lane.

        ``distance_m`` is the integral of the measured speed, None where the car does not measure it.
        """
        measured = self._measured_s > 0.0
        return {
            "duration_s": self._duration_s,
            "distance_m": self._distance_m if measured else None,
            "departures": None,
            "interventions": None,
            "autonomy_percent": None,
            "max_lateral_error_m": None,
            "rms_lateral_error_m": None,
            "max_lateral_accel_mps2": None,
            "max_lateral_jerk_mps3": None,
            "max_decel_mps2": None,
            "collisions": None,
            "min_time_gap_s": None,
            "mean_speed_mps": self._distance_m / self._measured_s if measured else None,
            "max_fear": self._max_fear,
            "mean_fear": self._fear_s / self._feared_s if self._feared_s else None,
            "modes": {name: round(held_s, 3) for name, held_s in self._modes.items()},
            "causes": {name: round(held_s, 3) for name, held_s in self._causes.items()},
            "realtime_factor": None,
            "trace_sha256": None,
        }
