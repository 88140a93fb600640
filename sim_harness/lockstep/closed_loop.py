"""Every step in one process on simulated time: the lock-step loop.

Per vehicle period, in this order: the vehicle advances under the last command; the camera takes a picture when one
is due; what was seen reaches the supervisor ``latency_s`` after the capture; the controller commands. Nothing here
reads a clock but for the real-time factor, so that a scenario and a seed give the same trace bit for bit.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Set
from dataclasses import asdict, dataclass, field
from typing import Any

import cv2

import controller.controller
import controller.limiter
import perception.estimators
import perception.lead.finder
import supervisor.supervisor
from controller.controller import Controller
from perception.camera.image_statistics import ImageStatistician
from perception.estimators import Estimator
from perception.lead.finder import LeadFinder
from sim_harness.judging.conditions.expect import judge
from sim_harness.judging.metrics import Metrics, measure, measure_further
from sim_harness.judging.trace import Recorder, Trace
from sim_harness.lockstep.camera import Shot, SimulatedCamera
from sim_harness.lockstep.lead_model import LeadModel, build_lead_model
from sim_harness.lockstep.oracle import Oracle, clear_view
from sim_harness.lockstep.vehicle import SimulatedVehicle, SimulatorSettings, load_simulator
from sim_harness.scenarios.events import with_events, with_manoeuvres
from sim_harness.scenarios.faults import EstimatorBias, LostLane, LostProcess
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight
from sim_harness.world.render.renderer import Renderer
from supervisor.supervisor import Supervisor
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import (
    Command,
    Decision,
    Frame,
    ImageStatistics,
    LeadVehicle,
    SimTruth,
    SteeringEstimate,
    VehicleState,
)
from trepid.vehicle import Vehicle

_SAME_INSTANT_S = 1e-9
NOBODY: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The nodes of one run."""

    vehicle: SimulatedVehicle
    camera: SimulatedCamera
    estimators: Mapping[str, Estimator]
    statistician: ImageStatistician
    supervisor: Supervisor
    controller: Controller
    oracles: Mapping[str, Oracle] = field(
        default_factory=dict
    )  # instead of estimators, where sight is the truth
    lead: LeadFinder | LeadModel | None = None  # None: the vehicle ahead is told of exactly


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """What is known at the end of one vehicle period: the newest message of each topic."""

    now_s: float
    truth: SimTruth
    state: VehicleState
    frame: Frame | None  # that arrived in this period
    estimates: Mapping[str, SteeringEstimate | None]
    statistics: ImageStatistics | None
    lead: LeadVehicle | None
    decision: Decision | None
    command: Command | None


Witness = Callable[[Instant], None]
"""Is told of every instant of a run, the run-up included."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One run: its verdict, its scores and its trace."""

    scenario: str
    seed: int
    reasons: tuple[str, ...]  # why it failed; empty when it passed
    metrics: Metrics
    realtime_factor: float
    trace: Trace

    def row(self) -> dict[str, Any]:
        """The run as ``sim run --json`` prints it: the fields of design §7, then further scores."""
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            "status": "failed" if self.reasons else "passed",
            "reasons": list(self.reasons),
            **asdict(self.metrics),
            "realtime_factor": round(self.realtime_factor, 2),
            "trace_sha256": self.trace.sha256,
            **asdict(measure_further(self.trace)),
        }


def run(
    scenario: Scenario, *, seed: int = 0, parts: Parts | None = None, witness: Witness | None = None
) -> Result:
    """Drive ``scenario`` once and judge it; ``parts`` instead of the real nodes are for tests.

    Raises InputError when the scenario does not fit together.
    """
    cv2.setNumThreads(1)
    simulator = load_simulator()
    loop = ClosedLoop(scenario, parts or build_parts(scenario, seed=seed), simulator, witness)
    started_s = time.perf_counter()
    trace = loop.drive()
    wall_s = time.perf_counter() - started_s
    metrics = measure(trace)
    return Result(
        scenario=scenario.name,
        seed=seed,
        reasons=tuple(judge(scenario.expect, metrics, trace)),
        metrics=metrics,
        realtime_factor=metrics.duration_s / wall_s,
        trace=trace,
    )


def build_parts(scenario: Scenario, *, seed: int) -> Parts:
    """The same nodes as the processes of a live drive run. Raises InputError."""
    road = scenario.build_road()
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    limiter = controller.limiter.build()
    renderer = None
    if scenario.sight is Sight.CAMERA:
        renderer = Renderer(road, camera, seed=seed, disturbances=scenario.disturbances)
    return Parts(
        vehicle=SimulatedVehicle(scenario, road, vehicle, limiter, load_simulator(), seed=seed),
        camera=SimulatedCamera(scenario, renderer),
        estimators={name: perception.estimators.build(name) for name in scenario.estimators if renderer},
        statistician=ImageStatistician(),
        supervisor=supervisor.supervisor.build(
            rules=scenario.rules_file, cruise_speed_mps=scenario.speed_mps
        ),
        controller=controller.controller.build(),
        oracles={name: Oracle(name, road, vehicle) for name in scenario.estimators if not renderer},
        lead=_lead_sensor(scenario, seed=seed),
    )


def _lead_sensor(scenario: Scenario, *, seed: int) -> LeadFinder | LeadModel | None:
    match scenario.leads_by:
        case LeadSensor.CAMERA:
            return perception.lead.finder.build()
        case LeadSensor.MODELLED:
            return build_lead_model(seed=seed)
        case LeadSensor.TRUTH:
            return None


@dataclass(frozen=True, slots=True)
class _Sight:
    """What was seen in one frame, and when the supervisor gets it."""

    due_s: float
    estimates: dict[str, SteeringEstimate]
    statistics: ImageStatistics
    lead: LeadVehicle | None


class ClosedLoop:
    """One run. Holds the newest message of each topic, as every live process does."""

    def __init__(
        self,
        scenario: Scenario,
        parts: Parts,
        simulator: SimulatorSettings,
        witness: Witness | None = None,
    ) -> None:
        self._scenario = scenario
        self._witness = witness
        self._parts = parts
        self._simulator = simulator
        self._underway: deque[_Sight] = deque()
        self._estimates: dict[str, SteeringEstimate | None] = dict.fromkeys(scenario.estimators)
        self._statistics: ImageStatistics | None = None
        self._lead: LeadVehicle | None = None
        self._decision: Decision | None = None
        self._command: Command | None = None
        self._commanded_s: float | None = None
        self._decide_by_s = -math.inf
        self._gone = [fault for fault in scenario.faults if isinstance(fault, LostProcess)]

    def drive(self) -> Trace:
        """Drive until the route or the duration is over. The trace begins at t = 0, after any run-up."""
        recorder = Recorder(self._scenario.estimators)
        manoeuvres: list[tuple[str, ...]] = []
        period_s, parts = self._simulator.period_s, self._parts
        shot_due = due_ticks(period_s, 1.0 / self._scenario.camera.rate_hz)
        command_due = due_ticks(period_s, self._simulator.control_period_s)
        first = -round(self._simulator.run_up_s / period_s) if self._scenario.start.speed_mps else 0
        for tick in range(first, math.floor(self._scenario.duration_s / period_s + 0.5) + 1):
            now_s = tick * period_s
            lost = self._lost(now_s)
            state, truth = parts.vehicle.step(self._command, self._commanded_s, now_s=now_s)
            shot = None
            if shot_due(tick) and "camera" not in lost:
                shot = parts.camera.shoot(truth, now_s=now_s)
                if shot is not None:
                    self._underway.append(self._look(shot, state, lost, now_s))
            seen = bool(self._underway) and self._arrive(now_s)
            decided = (seen or now_s >= self._decide_by_s - _SAME_INSTANT_S) and "supervisor" not in lost
            if decided:
                self._decide(state, now_s)
            if (decided or command_due(tick)) and "controller" not in lost:
                self._command = parts.controller.step(self._decision, state, now_s=now_s)
                self._commanded_s = now_s
            if self._witness is not None:
                self._witness(self._instant(now_s, truth, state, shot))
            if tick >= 0:
                recorder.add(truth, state, self._command, self._decision, self._estimates)
                manoeuvres.append(truth.manoeuvres)
            if truth.finished:
                break
        return self._with_events(recorder.trace(), manoeuvres)

    def _instant(self, now_s: float, truth: SimTruth, state: VehicleState, shot: Shot | None) -> Instant:
        return Instant(
            now_s=now_s,
            truth=truth,
            state=state,
            frame=shot.frame if shot else None,
            estimates=self._estimates,
            statistics=self._statistics,
            lead=self._lead,
            decision=self._decision,
            command=self._command,
        )

    def _with_events(self, trace: Trace, manoeuvres: list[tuple[str, ...]]) -> Trace:
        """``trace`` with what happened when, for conditions to name."""
        scenario, road = self._scenario, self._parts.vehicle.road
        trace = with_events(
            trace,
            faults=scenario.faults,
            disturbances=scenario.disturbances,
            lap_m=road.length_m if road.closed else None,
        )
        return with_manoeuvres(trace, scenario.manoeuvres, manoeuvres)

    def _lost(self, now_s: float) -> Set[str]:
        """Processes that are gone now. Afterwards they go on where they were, as after SIGSTOP and SIGCONT."""
        return {fault.process for fault in self._gone if fault.active(now_s)} if self._gone else NOBODY

    def _look(self, shot: Shot, state: VehicleState, lost: Set[str], now_s: float) -> _Sight:
        """What the estimators that are there make of ``shot``."""
        parts, frame = self._parts, shot.frame
        if frame is not None:
            seen = {
                n: e.step(frame, state, now_s=now_s) for n, e in parts.estimators.items() if n not in lost
            }
        else:
            seen = {name: o.step(shot.truth) for name, o in parts.oracles.items() if name not in lost}
        return _Sight(
            now_s + self._scenario.camera.latency_s,
            {name: self._biased(name, estimate, now_s) for name, estimate in seen.items()},
            parts.statistician.step(frame, now_s=now_s) if frame else clear_view(shot.truth.t_s),
            self._look_ahead(frame, state, now_s) if "lead" not in lost else None,
        )

    def _look_ahead(self, frame: Frame | None, state: VehicleState, now_s: float) -> LeadVehicle | None:
        """The vehicle ahead; the detector knows the lanes of the frames before, as a process of its own does."""
        match self._parts.lead:
            case LeadFinder() as finder:
                return finder.step(frame, state, self._estimates.values(), now_s=now_s) if frame else None
            case LeadModel() as model:
                return model.step(self._parts.vehicle.sense_lead())
        return self._parts.vehicle.sense_lead()

    def _biased(self, name: str, estimate: SteeringEstimate, now_s: float) -> SteeringEstimate:
        """What the estimator says under the faults that it has now."""
        for fault in self._scenario.faults:
            if isinstance(fault, EstimatorBias | LostLane) and fault.active(now_s):
                estimate = fault.told(estimate) if fault.estimator in (name, None) else estimate
        return estimate

    def _arrive(self, now_s: float) -> bool:
        """Take in what has reached the supervisor by now; True when there is something new."""
        seen = False
        while self._underway and self._underway[0].due_s <= now_s + _SAME_INSTANT_S:
            sight = self._underway.popleft()
            self._estimates.update(sight.estimates)
            self._statistics, self._lead = sight.statistics, sight.lead or self._lead
            seen = True
        return seen

    def _decide(self, state: VehicleState, now_s: float) -> None:
        self._decision = self._parts.supervisor.step(
            self._estimates, self._statistics, self._lead, state, now_s=now_s
        )
        self._decide_by_s = now_s + self._simulator.idle_decision_period_s


def due_ticks(period_s: float, every_s: float) -> Callable[[int], bool]:
    """Whether a tick is the first in its span of ``every_s``."""
    spans = period_s / every_s
    return lambda tick: math.floor(tick * spans + 1e-6) > math.floor((tick - 1) * spans + 1e-6)
