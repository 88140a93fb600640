"""Messages of a live drive as received by the launcher: trace, latencies, heartbeats."""

from dataclasses import dataclass, field

import numpy as np

from sim_harness.judging.trace import Recorder, Trace
from trepid.bus import Bus
from trepid.clock import Clock
from trepid.messages import Command, Decision, Diagnostic, SimTruth, SteeringEstimate, VehicleState
from trepid.processes.process import MALFORMED, READY
from trepid.topics import COMMAND, DECISION, DIAGNOSTICS, SIM_TRUTH, VEHICLE_STATE, estimate_topic


@dataclass(slots=True)
class Latency:
    """Age of messages since the capture of their frame: one number per frame."""

    newest_t_s: float  # earlier frames do not count
    samples_ms: list[float] = field(default_factory=list)

    def add(self, t_s: float | None, received_s: float) -> None:
        """Count the first message of a new frame; later ones repeat it."""
        if t_s is not None and t_s > self.newest_t_s:
            self.newest_t_s = t_s
            self.samples_ms.append(1e3 * (received_s - t_s))

    def summary(self) -> dict[str, float] | None:
        """Median, 99th percentile and maximum [ms]; None without messages."""
        if not self.samples_ms:
            return None
        p50, p99 = np.percentile(self.samples_ms, [50, 99])
        return {"p50": round(p50, 2), "p99": round(p99, 2), "max": round(max(self.samples_ms), 2)}


class DriveLog:
    """Receives all topics; one trace sample for each truth of the simulated vehicle."""

    def __init__(self, bus: Bus, clock: Clock, estimators: tuple[str, ...]) -> None:
        self.now_s = clock
        self._bus = bus
        self._truths = bus.stream(SIM_TRUTH)
        self._states = bus.latest(VEHICLE_STATE)
        self._commands = bus.stream(COMMAND)
        self._decisions = bus.stream(DECISION)
        self._diagnostics = bus.stream(DIAGNOSTICS)
        self._estimates = {name: bus.stream(estimate_topic(name)) for name in estimators}
        self._estimators = estimators
        self.truth: SimTruth | None = None
        self.state: VehicleState | None = None
        self.command: Command | None = None
        self.decision: Decision | None = None
        self.estimates: dict[str, SteeringEstimate | None] = dict.fromkeys(estimators)
        self.diagnostics: dict[str, Diagnostic] = {}
        self.restart()

    def restart(self) -> None:
        """Discard trace and latencies at the begin of the drive."""
        self._recorder = Recorder(self._estimators)
        self.manoeuvres: list[tuple[str, ...]] = []  # of the other vehicles, one item per sample of the trace
        self._beats: dict[str, list[Diagnostic]] = {}
        ends = (*self._estimators, "decision", "command")
        self.latency = {f"frame_to_{name}": Latency(self.now_s()) for name in ends}

    def receive(self, timeout_s: float) -> None:
        """Wait for messages up to ``timeout_s``, then add all received ones."""
        self._bus.wait(timeout_s)
        for name, stream in self._estimates.items():
            for estimate, received_s in stream.drain():
                self.estimates[name] = estimate
                self.latency[f"frame_to_{name}"].add(estimate.t_s, received_s)
        for decision, received_s in self._decisions.drain():
            self.decision = decision
            self.latency["frame_to_decision"].add(decision.t_s, received_s)
        for command, received_s in self._commands.drain():
            self.command = command
            self.latency["frame_to_command"].add(command.t_s, received_s)
        for diagnostic, _ in self._diagnostics.drain():
            self.diagnostics[diagnostic.process] = diagnostic
            self._beats.setdefault(diagnostic.process, []).append(diagnostic)
        self.state = self._states.refresh()
        for truth, _ in self._truths.drain():
            self.truth = truth
            if self.state is not None:
                self._recorder.add(truth, self.state, self.command, self.decision, self.estimates)
                self.manoeuvres.append(truth.manoeuvres)

    def load(self, process: str) -> dict[str, float | None]:
        """Mean steps per second and share of a core [%] of a process over the drive; None without heartbeats."""
        beats = [dict(beat.values) for beat in self._beats.get(process, []) if beat.message != READY]
        return {
            key: round(float(np.mean([float(beat[key]) for beat in beats])), 1) if beats else None
            for key in ("rate_hz", "cpu_percent")
        }

    def malformed(self, process: str) -> int:
        """Number of malformed messages that a process has reported over its life."""
        beat = self.diagnostics.get(process)
        return sum(int(count) for key, count in beat.values if key.startswith(MALFORMED)) if beat else 0

    def trace(self) -> Trace:
        """The drive so far."""
        return self._recorder.trace()
