"""Messages of a live drive as received by the launcher: the newest, heartbeats, times of the frames."""

from collections.abc import Callable
from typing import Any

from drive.course import Judge
from drive.loads import Loads, number
from drive.tally import Tally
from trepid.bus import Bus, Stream
from trepid.clock import Clock
from trepid.messages import Command, Decision, Diagnostic, SimTruth, SteeringEstimate, Timing, VehicleState
from trepid.processes.process import MALFORMED
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
from vehicle.driver.stop_button import STOPPED


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
    def waits_for(self) -> str:
        """Why the car stands and what would end that: the stop button, else the supervisor; "": it may drive."""
        beats = self.diagnostics.values()
        held = next((beat.message for beat in beats if beat.message.startswith(STOPPED)), "")
        return held or (self.decision.waits_for if self.decision is not None else "")

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
                self.diagnostics[message.process] = message
                self.loads.add(message)

    def malformed(self, process: str) -> int:
        """Number of malformed messages that a process has reported over its life."""
        beat = self.diagnostics.get(process)
        values = beat.values if beat else ()
        counts = (number(values, key) for key, _ in values if key.startswith(MALFORMED))
        return sum(int(count) for count in counts if count is not None)
