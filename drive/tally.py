"""Scores of a drive that need no true lane: how far the car drove by itself, and where a person took over."""

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from drive.course import Verdict
from trepid.causes import Cause
from trepid.messages import Decision, Mode, SimTruth, VehicleState

if TYPE_CHECKING:
    from drive.log import DriveLog

LONGEST_S = 1.0  # a longer gap between two states is not counted as driven
INTERVENTION_S = 6.0  # that an intervention counts as not driven
DRIVEN_M = 0.5  # a car that went less far did not drive


def has_driven(distance_m: float | None, engaged_percent: float) -> bool:
    """Whether the car drove by itself: it was engaged for some time, and went DRIVEN_M or an unknown distance."""
    return engaged_percent > 0.0 and (distance_m is None or distance_m >= DRIVEN_M)


def autonomy_percent(interventions: int, duration_s: float) -> float:
    """100·(1 - 6 s·interventions/duration), at least 0: Bojarski et al. (2016), section 5.2."""
    return max(0.0, 100.0 * (1.0 - INTERVENTION_S * interventions / duration_s))


class Takeovers:
    """The moments at which a person stopped the car, or took over, after it had driven by itself."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        """One line for each, with its time after the first state [s]."""
        self._first_s: float | None = None
        self._engaged = False  # the car has driven since the last one
        self._person = False

    @property
    def count(self) -> int:
        """Number of them, each of which is an intervention."""
        return len(self.notes)

    def add(self, state: VehicleState, decision: Decision | None) -> None:
        """Note ``state``, and the newest decision before it."""
        self._first_s = state.t_s if self._first_s is None else self._first_s
        person = state.stop_pressed or state.driver_override
        if person and not self._person and self._engaged:
            what = "stopped the car" if state.stop_pressed else "took over"
            self.notes.append(f"a person {what} at {state.t_s - self._first_s:.1f} s")
        self._person = person
        self._engaged = not person and (self._engaged or _drives(decision))


def _drives(decision: Decision | None) -> bool:
    return decision is not None and decision.mode is not Mode.STOP


class Tally:
    """Sums over the states of the vehicle; their size does not grow with the drive. The judge of a real car."""

    def __init__(self) -> None:
        self._last: VehicleState | None = None
        self._duration_s = self._measured_s = self._distance_m = self._feared_s = self._fear_s = 0.0
        self._max_fear: float | None = None
        self._modes: defaultdict[str, float] = defaultdict(float)
        self._causes: defaultdict[str, float] = defaultdict(float)
        self._takeovers = Takeovers()
        self._stop_cause: str | None = None
        self._stops = False  # in the newest decision

    def add(self, message: SimTruth | VehicleState, log: "DriveLog") -> None:
        """Count the time since the last state of the vehicle for this one."""
        if isinstance(message, VehicleState):
            self._count(message, log.decision)
            self._takeovers.add(message, log.decision)

    def verdict(self, problems: Sequence[str], *, elapsed_s: float) -> Verdict:
        """The sums; nothing but ``problems`` fails a drive without a true lane."""
        scores = self.row()
        driven = has_driven(scores["distance_m"], scores["engaged_percent"])
        return Verdict([*problems], scores, driven, tuple(self._takeovers.notes))

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
            stops = decision.mode is Mode.STOP
            if stops and not self._stops:
                self._stop_cause = str(decision.cause)
            elif not stops and self._stop_cause == Cause.STARTING:
                self._stop_cause = None
            self._stops = stops

    def _engaged_share_percent(self) -> float:
        """Share of the time in a mode that drives [%]; 0.0 without any decision."""
        driving_s = sum(held_s for mode, held_s in self._modes.items() if mode != Mode.STOP)
        return 100.0 * driving_s / self._duration_s if self._duration_s else 0.0

    def row(self) -> dict[str, Any]:
        """The fields of a simulated drive, in their order; None for those that need the true lane.

        ``distance_m`` is the integral of the measured speed, None where the car does not measure it.
        """
        measured = self._measured_s > 0.0
        distance_m, engaged_percent = self._distance_m if measured else None, self._engaged_share_percent()
        interventions, driven = self._takeovers.count, has_driven(distance_m, engaged_percent)
        return {
            "duration_s": self._duration_s,
            "distance_m": distance_m,
            "departures": None,
            "interventions": interventions,
            "autonomy_percent": autonomy_percent(interventions, self._duration_s) if driven else None,
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
            "engaged_percent": engaged_percent,
            "stop_cause": self._stop_cause,
            "realtime_factor": None,
            "trace_sha256": None,
        }
