"""A live drive: starts all processes over Zenoh, monitors them and evaluates the drive.

The launcher receives and displays messages and restarts processes that ended, so that the stop after a failure is
steered. It ends the drive at the end of the route, after the requested duration, at standstill after the loss of a
process, or on a signal.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sim_harness.judging.conditions.expect import judge
from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import Trace
from sim_harness.live.drive_log import DriveLog
from sim_harness.live.plan import context_of, planned
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.faults import EstimatorBias, LostLane
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight
from trepid.bus import Bus, free_endpoint, open_bus
from trepid.clock import Clock, epoch_clock, epoch_offset_ns
from trepid.config import InputError, Settings
from trepid.processes.access import published_by
from trepid.processes.fused import gathered
from trepid.processes.launch import Fleet
from trepid.processes.settings import load_processes
from trepid.recording.writer import BusRecorder
from trepid.security import LAUNCHER, drive_endpoint, session_settings
from trepid.types import Positive
from vehicle.keys.check import check_keys

Show = Callable[[DriveLog, Fleet, float], None]
"""Displays the drive so far: log, processes, elapsed time [s]."""


class DriveSettings(Settings):
    """``config/drive.yaml``."""

    vehicle_name: str
    ready_timeout_s: Positive
    silence_s: Positive
    standstill_mps: Positive
    stop_timeout_s: Positive
    status_period_s: Positive


def drive(
    scenario: Scenario, settings: DriveSettings, *, seed: int, show: Show, record: Path | None = None
) -> dict[str, Any]:
    """Drive ``scenario`` live and return its row of ``drive --json``.

    Raises InputError for a scenario that only the lock-step loop can simulate, and for invalid configuration.
    """
    for what in lockstep_only(scenario):
        raise InputError(f"scenario {scenario.name}: {what} acts in lock-step only: trepid sim run")
    specs = gathered(planned(load_processes(), scenario))
    names = {spec.name for spec in specs}
    for fault in scenario.faults:
        if getattr(fault, "process", None) not in {None, *names}:
            raise InputError(
                f"scenario {scenario.name}: the process of the fault {fault.kind} shares one: together"
            )
    check_configuration([scenario])
    offset_ns = epoch_offset_ns()
    clock = epoch_clock(offset_ns)
    endpoint = drive_endpoint(free_endpoint())
    check_keys([spec.name for spec in specs])
    secured = session_settings(LAUNCHER, publishes=published_by(specs), listen=endpoint)
    with (
        caught_signals() as signals,
        open_bus(settings.vehicle_name, clock, listen=endpoint, further=secured) as bus,
        Fleet(
            specs,
            vehicle_name=settings.vehicle_name,
            endpoint=endpoint,
            clock_offset_ns=offset_ns,
            context=context_of(scenario, scenario.estimators, seed),
        ) as fleet,
        BusRecorder(record, bus, [scenario.rules_file]) if record else nullcontext() as recording,
    ):
        referee = Referee(bus, clock, fleet, scenario, settings, show, recording)
        if referee.wait_until_ready(signals):
            referee.watch(signals)
        return referee.row(seed)


def lockstep_only(scenario: Scenario) -> Iterator[str]:
    """The parts of ``scenario`` that a live drive cannot simulate."""
    if scenario.sight is Sight.TRUTH:
        yield "sight: truth"
    if scenario.leads_by is LeadSensor.MODELLED:
        yield "lead_sensor: modelled"
    yield from (fault.kind for fault in scenario.faults if isinstance(fault, EstimatorBias | LostLane))


class Referee:
    """Monitors one drive and evaluates it."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        fleet: Fleet,
        scenario: Scenario,
        settings: DriveSettings,
        show: Show,
        recording: BusRecorder | None,
    ) -> None:
        self._recording = recording
        self._clock = clock
        self._fleet = fleet
        self._scenario = scenario
        self._settings = settings
        self._show = show
        self._log = DriveLog(bus, clock, scenario.estimators)
        self._problems: list[str] = []
        self._began_s = clock()
        self._shown_s = self._began_s
        self._lost_s: float | None = None  # time of the first loss of a process
        self._paused: set[str] = set()  # processes that a fault of the scenario has paused
        self._resumed_s: dict[str, float] = {}  # time of their resumption

    def wait_until_ready(self, signals: list[str]) -> bool:
        """Wait for a heartbeat of every process, a first decision, and the end of any run-up.

        False when that fails. Raises InputError when a process refuses its input.
        """
        while not signals and not self._problems:
            self._receive()
            for exited in self._fleet.collect_exits():
                if exited.from_bad_input:
                    raise InputError(str(exited))
                self._problems.append(f"{exited} before the drive began")
            missing = [name for name in self._fleet.children if name not in self._log.diagnostics]
            if not missing and self._log.decision is not None and self._begun():
                self._log.restart()
                self._began_s = self._clock()
                if self._recording is not None:
                    self._recording.began(self._began_s)
                return True
            if self._elapsed_s() > self._settings.ready_timeout_s:
                waited = f"after {self._settings.ready_timeout_s:.0f} s"
                self._problems.append(
                    f"not ready {waited}: nothing received of {', '.join(missing) or 'decisions'}"
                )
        self._problems += signals
        return False

    def watch(self, signals: list[str]) -> None:
        """Monitor until the end of the route or the duration, standstill after a loss, or a signal."""
        while not signals:
            self._receive()
            self._simulate_losses()
            self._end_silent_processes()
            for exited in self._fleet.collect_exits():
                self._problems.append(f"{exited} at {self._elapsed_s():.1f} s")
                self._log.diagnostics.pop(exited.name, None)
                self._lost_s = self._lost_s or self._elapsed_s()
                if exited.name == "vehicle":
                    return  # it contains the simulated car
            if (
                self._elapsed_s() >= self._scenario.duration_s
                or (self._log.truth is not None and self._log.truth.finished)
                or self._stopped_after_loss()
            ):
                return
        self._problems += signals

    def row(self, seed: int) -> dict[str, Any]:
        """The result of the run as a row of ``drive --json``."""
        trace = self._trace()
        row: dict[str, Any] = {"scenario": self._scenario.name, "seed": seed}
        reasons = list(self._problems)
        if len(trace) < 2:
            return row | {"status": "failed", "reasons": reasons or ["no samples were recorded"]}
        metrics = measure(trace)
        reasons += judge(self._scenario.expect, metrics, trace)
        row |= {"status": "failed" if reasons else "passed", "reasons": reasons, **asdict(metrics)}
        row |= {
            "realtime_factor": round(metrics.duration_s / self._elapsed_s(), 3),
            "trace_sha256": trace.sha256,
            "final_speed_mps": self._log.state.speed_mps if self._log.state else None,
            "processes": {
                name: {
                    "pid": child.popen.pid,
                    "restarts": child.restarts,
                    **self._log.load(name),
                    "malformed": self._log.malformed(name),
                }
                for name, child in self._fleet.children.items()
            },
            "latency_ms": self._log.times.latency_ms(),
            "stages_ms": self._log.times.stages_ms(),
        }
        return row

    def _trace(self) -> Trace:
        """The drive so far, with its events."""
        trace, scenario = self._log.trace(), self._scenario
        if len(trace) == 0:
            return trace
        return with_events(trace, scenario, scenario.build_road(), self._log.manoeuvres)

    def _simulate_losses(self) -> None:
        """Pause the processes that a fault of the scenario loses now, and resume the others."""
        lost = self._scenario.lost_processes(self._elapsed_s())
        for name in lost - self._paused:
            self._fleet.pause(name)
        for name in self._paused - lost:
            self._fleet.resume(name)
            self._resumed_s[name] = self._clock()
        self._paused = lost

    def _receive(self) -> None:
        self._log.receive(timeout_s=0.02)
        if self._recording is not None:
            self._recording.write()
        now_s = self._clock()
        if now_s - self._shown_s >= self._settings.status_period_s:
            self._shown_s = now_s
            self._show(self._log, self._fleet, self._elapsed_s())

    def _elapsed_s(self) -> float:
        return self._clock() - self._began_s

    def _begun(self) -> bool:
        """True from the start of the run on; before a start at speed a driver brings the car there."""
        truth = self._log.truth
        return truth is not None and truth.elapsed_s is not None and truth.elapsed_s >= 0.0

    def _end_silent_processes(self) -> None:
        """End processes that run without heartbeats, so that they are started again."""
        for name, beat in self._log.diagnostics.items():
            silent_s = self._clock() - max(beat.t_s, self._resumed_s.get(name, beat.t_s))
            if name in self._paused:
                continue
            if silent_s > self._settings.silence_s and self._fleet.children[name].popen.poll() is None:
                self._problems.append(f"process {name} was silent for {silent_s:.1f} s")
                self._fleet.kill(name)

    def _stopped_after_loss(self) -> bool:
        """True at standstill after the loss of a process, or after the time limit for it."""
        if self._lost_s is None or self._log.state is None or self._log.state.speed_mps is None:
            return False
        if self._log.state.speed_mps < self._settings.standstill_mps:
            self._problems.append(f"the car stopped {self._elapsed_s() - self._lost_s:.1f} s after that")
            return True
        if self._elapsed_s() - self._lost_s > self._settings.stop_timeout_s:
            self._problems.append(
                f"the car did not stop within {self._settings.stop_timeout_s:.0f} s after that"
            )
            return True
        return False


@contextmanager
def caught_signals() -> Iterator[list[str]]:
    """A list of the termination signals received so far, as text."""
    caught: list[str] = []
    names = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def catch(number: int, _: object) -> None:
        caught.append(f"stopped by {signal.Signals(number).name}")

    before = {number: signal.signal(number, catch) for number in names}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
