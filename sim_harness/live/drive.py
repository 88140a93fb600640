"""The main job: every process of the car over Zenoh, started, watched and judged.

The launcher drives nothing. It starts the processes, listens, shows what it hears, starts again what dies (so
that the stop that follows stays steered), and ends the drive: at the end of the route, after the asked duration,
once the car stands after a process was lost, or on a signal.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from sim_harness.judging.conditions.expect import judge
from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import Trace
from sim_harness.live.drive_log import DriveLog
from sim_harness.scenarios.events import with_events, with_manoeuvres
from sim_harness.scenarios.faults import EstimatorBias, LostLane, LostProcess
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight
from trepid.bus import Bus, free_endpoint, open_bus
from trepid.clock import Clock, epoch_clock, epoch_offset_ns
from trepid.config import InputError, Settings
from trepid.processes.launch import Fleet, ProcessSpec
from trepid.recording.writer import BusRecorder
from trepid.types import Positive

Show = Callable[[DriveLog, Fleet, float], None]
"""Shows the drive so far: log, processes, elapsed time [s]."""


class DriveSettings(Settings):
    """``config/drive.yaml``."""

    vehicle_name: str
    ready_timeout_s: Positive
    max_restarts: Annotated[int, Field(ge=0)]
    silence_s: Positive
    standstill_mps: Positive
    stop_timeout_s: Positive
    status_period_s: Positive


def processes(scenario: Scenario, seed: int) -> tuple[ProcessSpec, ...]:
    """Every process of a simulated drive, in one list; the first estimator also judges the image."""
    simulated = {"scenario": scenario.model_dump(mode="json"), "seed": seed}
    return (
        ProcessSpec(
            "vehicle", "sim_harness.live.vehicle_node", simulated, restart=False
        ),  # it would jump to the start
        ProcessSpec("camera", "sim_harness.live.camera_node", simulated),
        *(
            ProcessSpec(
                name, "perception.node", {"estimator": name, "statistics": name == scenario.estimators[0]}
            )
            for name in scenario.estimators
        ),
        *_lead_processes(scenario),
        ProcessSpec(
            "supervisor",
            "supervisor.node",
            {
                "estimators": scenario.estimators,
                "cruise_speed_mps": scenario.speed_mps,
                "rules": str(scenario.rules_file.resolve()),  # processes run in the root
            },
        ),
        ProcessSpec("controller", "controller.node"),
    )


def _lead_processes(scenario: Scenario) -> tuple[ProcessSpec, ...]:
    if scenario.leads_by is not LeadSensor.CAMERA:
        return ()  # the vehicle process tells of it
    return (ProcessSpec("lead", "perception.lead.node", {"estimators": scenario.estimators}),)


def drive(
    scenario: Scenario, settings: DriveSettings, *, seed: int, show: Show, record: Path | None = None
) -> dict[str, Any]:
    """Drive ``scenario`` live and return its row of design §7 with ``processes`` and ``latency_ms``.

    Raises InputError for a scenario that only the lock-step loop can act out.
    """
    for what in lockstep_only(scenario):
        raise InputError(f"scenario {scenario.name}: {what} acts in lock-step only: trepid sim run")
    offset_ns = epoch_offset_ns()
    clock = epoch_clock(offset_ns)
    endpoint = free_endpoint()
    with (
        caught_signals() as signals,
        open_bus(settings.vehicle_name, clock, listen=endpoint) as bus,
        Fleet(
            processes(scenario, seed),
            vehicle_name=settings.vehicle_name,
            endpoint=endpoint,
            clock_offset_ns=offset_ns,
            max_restarts=settings.max_restarts,
        ) as fleet,
        BusRecorder(record, bus, [scenario.rules_file]) if record else nullcontext() as recording,
    ):
        referee = Referee(bus, clock, fleet, scenario, settings, show, recording)
        if referee.wait_until_ready(signals):
            referee.watch(signals)
        return referee.row(seed)


def lockstep_only(scenario: Scenario) -> Iterator[str]:
    """What of ``scenario`` no live drive can act out."""
    if scenario.sight is Sight.TRUTH:
        yield "sight: truth"
    if scenario.leads_by is LeadSensor.MODELLED:
        yield "lead_sensor: modelled"
    yield from (fault.kind for fault in scenario.faults if isinstance(fault, EstimatorBias | LostLane))


class Referee:
    """Watches one drive from the side and judges it."""

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
        self._lost_s: float | None = None  # when the first process was lost
        self._paused: set[str] = set()  # processes that the scenario has lost
        self._resumed_s: dict[str, float] = {}  # when those went on

    def wait_until_ready(self, signals: list[str]) -> bool:
        """Wait until every process has reported, there is a first decision, and any run-up is over.

        False when that fails.
        """
        while not signals and not self._problems:
            self._listen()
            self._problems += [f"{exited} before the drive began" for exited in self._fleet.collect_exits()]
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
                    f"not ready {waited}: heard nothing of {', '.join(missing) or 'decisions'}"
                )
        self._problems += signals
        return False

    def watch(self, signals: list[str]) -> None:
        """Watch until the route or the duration is driven, the car stands after a loss, or a signal came."""
        while not signals:
            self._listen()
            self._act_out_losses()
            self._end_silent_processes()
            for exited in self._fleet.collect_exits():
                self._problems.append(f"{exited} at {self._elapsed_s():.1f} s")
                self._log.diagnostics.pop(exited.name, None)
                self._lost_s = self._lost_s or self._elapsed_s()
                if exited.name == "vehicle":
                    return  # the simulated car is gone with it: there is nothing left to watch
            if (
                self._elapsed_s() >= self._scenario.duration_s
                or self._finished()
                or self._stopped_after_loss()
            ):
                return
        self._problems += signals

    def row(self, seed: int) -> dict[str, Any]:
        """The run as design §7 has it."""
        trace = self._trace()
        row: dict[str, Any] = {"scenario": self._scenario.name, "seed": seed}
        reasons = list(self._problems)
        if len(trace) < 2:
            return row | {"status": "failed", "reasons": reasons or ["nothing was driven"]}
        metrics = measure(trace)
        reasons += judge(self._scenario.expect, metrics, trace)
        row |= {"status": "failed" if reasons else "passed", "reasons": reasons, **asdict(metrics)}
        row |= {
            "realtime_factor": round(metrics.duration_s / self._elapsed_s(), 3),
            "trace_sha256": trace.sha256,
            "final_speed_mps": self._log.state.speed_mps if self._log.state else None,
            "processes": {
                name: {"pid": child.popen.pid, "restarts": child.restarts, **self._log.load(name)}
                for name, child in self._fleet.children.items()
            },
            "latency_ms": {name: latency.summary() for name, latency in self._log.latency.items()},
        }
        return row

    def _trace(self) -> Trace:
        """The drive so far, with what happened when."""
        trace, scenario = self._log.trace(), self._scenario
        if len(trace) == 0:
            return trace
        road = scenario.build_road()
        trace = with_events(
            trace,
            faults=scenario.faults,
            disturbances=scenario.disturbances,
            lap_m=road.length_m if road.closed else None,
        )
        return with_manoeuvres(trace, scenario.manoeuvres, self._log.manoeuvres)

    def _act_out_losses(self) -> None:
        """Pause the processes that the scenario has lost now, and let go on those that it has no more."""
        losses = [fault for fault in self._scenario.faults if isinstance(fault, LostProcess)]
        lost = {fault.process for fault in losses if fault.active(self._elapsed_s())}
        for name in lost - self._paused:
            self._fleet.pause(name)
        for name in self._paused - lost:
            self._fleet.resume(name)
            self._resumed_s[name] = self._clock()
        self._paused = lost

    def _listen(self) -> None:
        self._log.listen(timeout_s=0.02)
        if self._recording is not None:
            self._recording.write()
        now_s = self._clock()
        if now_s - self._shown_s >= self._settings.status_period_s:
            self._shown_s = now_s
            self._show(self._log, self._fleet, self._elapsed_s())

    def _elapsed_s(self) -> float:
        return self._clock() - self._began_s

    def _begun(self) -> bool:
        """The car is at its start, or beyond it; before a start at speed a driver brings it there."""
        truth = self._log.truth
        return truth is not None and truth.elapsed_s is not None and truth.elapsed_s >= 0.0

    def _finished(self) -> bool:
        return self._log.truth is not None and self._log.truth.finished

    def _end_silent_processes(self) -> None:
        """A process that runs but is silent is as good as dead: end it, so that it is started again."""
        for name, heard in self._log.diagnostics.items():
            silent_s = self._clock() - max(heard.t_s, self._resumed_s.get(name, heard.t_s))
            if name in self._paused:
                continue
            if silent_s > self._settings.silence_s and self._fleet.children[name].popen.poll() is None:
                self._problems.append(f"process {name} was silent for {silent_s:.1f} s")
                self._fleet.kill(name)

    def _stopped_after_loss(self) -> bool:
        """True once the car stands after a process was lost, or has had more than enough time for it."""
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
    """A list that fills with the names of the signals that ask this process to end."""
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
