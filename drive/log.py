"""Messages of a live drive as received by the launcher: the newest, heartbeats, times of the frames;
and the load of every process, from its heartbeats.
"""

import math
from collections.abc import Callable
from typing import Any

from drive.course import Judge
from drive.reason import own_stop, reason
from drive.tally import Tally
from trepid.bus import Bus, Stream
from trepid.causes import OWN_STOPS
from trepid.clock import Clock
from trepid.messages import Command, Decision, Diagnostic, SimTruth, SteeringEstimate, Timing, VehicleState
from trepid.processes.process import MALFORMED, READY, Values
from trepid.processes.settings import LAUNCHER
from trepid.processes.timing import FrameTimes
from trepid.topics import (
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    SIM_TRUTH,
    TIMING,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)

LOADS = ("rate_hz", "cpu_percent")
"""Values of a heartbeat: steps per second and share of a core [%]."""


class Loads:
    """Means over time of what heartbeats give for the time since the one before."""

    def __init__(self) -> None:
        self._beat_s: dict[str, float] = {}  # of the newest heartbeat, by process
        self._sums: dict[
            tuple[str, str], tuple[float, float]
        ] = {}  # time [s] and integral, by process and value

    def add(self, beat: Diagnostic) -> None:
        """Add a heartbeat; the first one of a process, and one that reports its start, only begin an interval."""
        before_s = self._beat_s.get(beat.process)
        self._beat_s[beat.process] = beat.t_s
        if before_s is None or beat.message == READY:
            return
        over_s = beat.t_s - before_s
        for key in LOADS:
            load = number(beat.values, key)
            if load is not None:
                time_s, integral = self._sums.get((beat.process, key), (0.0, 0.0))
                self._sums[beat.process, key] = time_s + over_s, integral + over_s * load

    def of(self, process: str) -> dict[str, float | None]:
        """Mean steps per second and share of a core [%] of a process; None without an interval."""
        return {key: self._mean(process, key) for key in LOADS}

    def _mean(self, process: str, key: str) -> float | None:
        time_s, integral = self._sums.get((process, key), (0.0, 0.0))
        return round(integral / time_s, 1) if time_s > 0.0 else None


def number(values: Values, key: str) -> float | None:
    """The value ``key`` of a heartbeat, which any program may send; None when it is absent or no finite number."""
    try:
        found = float(dict(values)[key])
    except (KeyError, ValueError):
        return None
    return found if math.isfinite(found) else None


class DriveLog:
    """Receives all topics, for the launcher and for the judge of the drive."""

    def __init__(
        self, bus: Bus, clock: Clock, estimators: tuple[str, ...], new_judge: Callable[[], Judge] = Tally
    ) -> None:
        self.now_s = clock
        self._new_judge = new_judge
        self._bus = bus
        topics: tuple[Topic[Any], ...] = (
            *map(estimate_topic, estimators),
            DECISION,
            COMMAND,
            TIMING,
            DIAGNOSTICS,
            VEHICLE_STATE,
            SIM_TRUTH,
        )
        self._streams: list[Stream[Any]] = [bus.stream(topic) for topic in topics]
        self._estimators = estimators
        self.waiting = ""
        """What the drive waits for before it begins; "" from its beginning on."""
        self.truth: SimTruth | None = None
        self.state: VehicleState | None = None
        self.command: Command | None = None
        self.decision: Decision | None = None
        self.estimates: dict[str, SteeringEstimate | None] = dict.fromkeys(estimators)
        self.diagnostics: dict[str, Diagnostic] = {}
        self.restart()

    def restart(self) -> None:
        """Discard judgement and latencies: the drive begins."""
        self.judge = self._new_judge()
        self.loads = Loads()
        self._began_s = self.now_s()
        self.times = FrameTimes(self._estimators)
        self.limiter_stops: list[str] = []
        """The stops of the limiter of its own accord, with their times; those by the button are interventions."""

    def receive(self, timeout_s: float) -> None:
        """Let messages gather for ``timeout_s``, then add all of them in the order of their publication.

        No message wakes this process, so that it does not compete with those that drive; the end of one does.
        """
        self._bus.wait(timeout_s)
        arrived = [
            (at_s, rank, message)
            for rank, stream in enumerate(self._streams)
            for message, at_s in stream.drain()
        ]
        for _, _, message in sorted(arrived, key=lambda entry: entry[:2]):
            self._add(message)

    @property
    def own_stop(self) -> str:
        """Why the vehicle process stops the car, whatever the decision; "": it does not."""
        return own_stop(self.diagnostics.values())

    @property
    def waits_for(self) -> str:
        """Why the car stands and what would end that, by vehicle process or supervisor; "": it may drive."""
        return self.own_stop or (self.decision.waits_for if self.decision is not None else "")

    @property
    def reason(self) -> str:
        """What the car does and why, in a sentence: of the vehicle process, else :func:`drive.reason.reason`."""
        driver = self.state is not None and self.state.driver_override
        return self.own_stop or reason(self.decision, command=self.command, driver=driver)

    def _add(self, message: Any) -> None:
        match message:
            case SimTruth():
                self.truth = message
                self.judge.add(message, self)
            case VehicleState():
                self.state = message
                self.judge.add(message, self)
            case Command():
                self.command = message
            case Decision():
                self.decision = message
            case SteeringEstimate():
                self.estimates[message.estimator] = message
            case Timing():
                self.times.add(message, from_s=self._began_s)
            case Diagnostic() if message.process != LAUNCHER:
                self._note_stop(message)
                self.diagnostics[message.process] = message
                self.loads.add(message)

    def _note_stop(self, beat: Diagnostic) -> None:
        """Note ``beat`` if the limiter has begun to stop the car since the heartbeat before."""
        before = self.diagnostics.get(beat.process)
        if beat.message.startswith(OWN_STOPS) and not (before and before.message.startswith(OWN_STOPS)):
            self.limiter_stops.append(f"at {beat.t_s - self._began_s:.1f} s {beat.message}")

    def malformed_count(self, process: str) -> int:
        """Number of malformed messages that a process has reported over its life."""
        beat = self.diagnostics.get(process)
        values = beat.values if beat else ()
        counts = (number(values, key) for key, _ in values if key.startswith(MALFORMED))
        return sum(int(count) for count in counts if count is not None)
