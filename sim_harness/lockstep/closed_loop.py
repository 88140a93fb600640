"""The lock-step loop: every node in one process on simulated time.

Per vehicle period, in this order: the vehicle advances under the last command; the camera takes a frame when one is
due; the results of a frame reach the supervisor ``latency_s`` after its capture; the controller commands. The clock
is read for the real-time factor only, so that a scenario and a seed give the same trace bit for bit.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import asdict, dataclass, field
from typing import Any

import cv2

import controller.controller
import controller.limiter
import perception.estimators
import perception.lead.finder
import perception.sight.judge
import supervisor.supervisor
from controller.controller import Controller
from drive.course import Verdict
from perception.estimators import Estimator
from perception.lead.finder import LeadFinder
from perception.sight.judge import ImageJudge
from sim_harness.judging.conditions.expect import is_driven, judge
from sim_harness.judging.metrics import Metrics, measure, measure_further
from sim_harness.judging.trace import Recorder, Trace
from sim_harness.lockstep.camera import FrameWithTruth, SimulatedCamera
from sim_harness.lockstep.foreign import CheckedWorld, WorldPictures, WorldVehicle
from sim_harness.lockstep.lead_model import LeadModel, build_lead_model
from sim_harness.lockstep.oracle import Oracle, clear_view
from sim_harness.lockstep.road_user_sensor import RoadUserSensor, build_road_user_sensor
from sim_harness.lockstep.road_users import nearest_gap_m
from sim_harness.lockstep.stack import Perception, Stack
from sim_harness.lockstep.vehicle import SimulatedVehicle, SimulatorSettings, load_simulator
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.faults import EstimatorBias, LostLane
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight
from sim_harness.scenarios.world_choice import WorldChoice
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.disturbance_table import load_table
from sim_harness.world.sight_truth import SightDistance, SightTruth, load_sight_settings
from supervisor.rules.rule_file import RuleFile
from supervisor.supervisor import Supervisor
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, default_file, load
from trepid.messages import (
    Command,
    Decision,
    Frame,
    ImageStatistics,
    LeadVehicle,
    RoadUsers,
    SimTruth,
    SteeringEstimate,
    VehicleState,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The nodes of one run."""

    vehicle: SimulatedVehicle | WorldVehicle
    camera: SimulatedCamera
    estimators: Mapping[str, Estimator]
    judge: ImageJudge
    supervisor: Supervisor
    controller: Controller
    oracles: Mapping[str, Oracle] = field(default_factory=dict)  # instead of estimators, for sight: truth
    lead: LeadFinder | LeadModel | None = None  # None: the exact distance of the vehicle ahead
    road_user_sensor: RoadUserSensor | None = None  # None: the camera's detector, where it finds people


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """The newest message of each topic at the end of one vehicle period."""

    now_s: float
    truth: SimTruth
    state: VehicleState
    frame: Frame | None  # arrived in this period
    sight: SightDistance | None  # true sight of the shot that arrived in this period
    estimates: Mapping[str, SteeringEstimate | None]
    statistics: ImageStatistics | None
    lead: LeadVehicle | None
    road_users: RoadUsers | None
    decision: Decision | None
    command: Command | None


VEHICLE_M = 5.0  # length of a car
Witness = Callable[[Instant], None]
"""Called at every instant of a run, including the run-up."""
Until = Callable[[Instant], bool]
"""Whether a run ends at this instant, before its duration is over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One run: its judgement, its scores and its trace."""

    scenario: str
    seed: int
    reasons: tuple[str, ...]  # why it failed; empty when it passed
    driven: bool  # the car drove, or was not to drive
    waits_for: str  # what the car waits for at the end; "" while it may drive
    metrics: Metrics
    realtime_factor: float
    trace: Trace

    def row(self) -> dict[str, Any]:
        """The run as ``sim run --json`` prints it: the fields of design §7, then further scores."""
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            "status": Verdict(list(self.reasons), {}, self.driven).status,
            "reasons": list(self.reasons),
            **asdict(self.metrics),
            "realtime_factor": round(self.realtime_factor, 2),
            "trace_sha256": self.trace.sha256,
            "waits_for": self.waits_for,
            **asdict(measure_further(self.trace)),
        }


def run(
    scenario: Scenario,
    *,
    seed: int = 0,
    parts: Parts | None = None,
    witness: Witness | None = None,
    until: Until | None = None,
) -> Result:
    """Drive ``scenario`` once and judge it; tests give their own ``parts`` instead of the real nodes.

    Raises InputError for a scenario with values that exclude each other.
    """
    cv2.setNumThreads(1)
    simulator = load_simulator()
    loop = ClosedLoop(scenario, parts or build_parts(scenario, seed=seed), simulator, witness, until)
    started_s = time.perf_counter()
    trace = loop.drive()
    wall_s = time.perf_counter() - started_s
    metrics = measure(trace)
    return Result(
        scenario=scenario.name,
        seed=seed,
        reasons=tuple(judge(scenario.expect, metrics, trace)),
        driven=is_driven(scenario.expect, metrics),
        waits_for=loop.waits_for,
        metrics=metrics,
        realtime_factor=metrics.duration_s / wall_s,
        trace=trace,
    )


def build_parts(scenario: Scenario, *, seed: int, simulator: SimulatorSettings | None = None) -> Parts:
    """The nodes that the processes of a live drive run; ``simulator``: default that of ``config/``.

    Raises InputError.
    """
    if scenario.world is not None:
        return _parts_in_world(scenario, scenario.world, seed=seed, simulator=simulator)
    road = scenario.build_road()
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    limiter = controller.limiter.build()
    renderer = None
    if scenario.sight is Sight.CAMERA:
        on_springs = scenario.plant.springs is not None
        renderer = Renderer(
            road, camera, seed=seed, disturbances=scenario.disturbances, on_springs=on_springs
        )
    simulated = SimulatedVehicle(scenario, road, vehicle, limiter, simulator or load_simulator(), seed=seed)
    return Parts(
        vehicle=simulated,
        camera=SimulatedCamera(
            scenario,
            renderer,
            SightTruth(road, camera, scenario.disturbances, seed=seed),
            wheelbase_m=vehicle.wheelbase_m,
        ),
        estimators={name: _estimator(scenario, name) for name in scenario.estimators if renderer},
        judge=perception.sight.judge.build(camera, vehicle),
        supervisor=supervisor.supervisor.build(
            rules=scenario.rules_file, cruise_speed_mps=scenario.speed_mps
        ),
        controller=controller.controller.build(),
        oracles={name: Oracle(name, simulated.road, vehicle) for name in scenario.estimators if not renderer},
        lead=_lead_sensor(scenario, seed=seed),
        road_user_sensor=build_road_user_sensor(scenario.road_users_by, seed=seed),
    )


def _parts_in_world(
    scenario: Scenario, choice: WorldChoice, *, seed: int, simulator: SimulatorSettings | None
) -> Parts:
    """The nodes of a run in a world of another package. Raises InputError."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    world = CheckedWorld(choice, camera, vehicle, seed=seed)
    settings = simulator or load_simulator()
    car = WorldVehicle(scenario, world, vehicle, controller.limiter.build(), settings, seed=seed)
    seen = scenario.sight is Sight.CAMERA
    names = scenario.estimators
    return Parts(
        vehicle=car,
        camera=SimulatedCamera(
            scenario, WorldPictures(world, seed) if seen else None, wheelbase_m=vehicle.wheelbase_m
        ),
        estimators={name: _estimator(scenario, name) for name in names if seen},
        judge=perception.sight.judge.build(camera, vehicle),
        supervisor=supervisor.supervisor.build(
            rules=scenario.rules_file, cruise_speed_mps=scenario.speed_mps
        ),
        controller=controller.controller.build(),
        oracles={name: Oracle(name, car.road, vehicle) for name in names if not seen},
        lead=_lead_sensor(scenario, seed=seed),
    )


def _estimator(scenario: Scenario, name: str) -> Estimator:
    return perception.estimators.build(name, network=scenario.networks.get(name))


def _lead_sensor(scenario: Scenario, *, seed: int) -> LeadFinder | LeadModel | None:
    match scenario.leads_by:
        case LeadSensor.CAMERA:
            return perception.lead.finder.build()
        case LeadSensor.MODELLED:
            return build_lead_model(seed=seed)
        case LeadSensor.TRUTH:
            return None


def check_configuration(scenarios: Iterable[Scenario]) -> None:
    """Load every file of settings, rules and weights that a run of ``scenarios`` reads.

    Raises InputError with file:line:column for the first invalid value.
    """
    scenarios = tuple(scenarios)
    load_simulator()
    load(CONFIG_DIR / "camera.yaml", Camera)
    load_sight_settings()
    load(default_file("fear.yaml"), RuleFile)  # its levels of fear are words of conditions
    controller.limiter.build()
    controller.controller.build()
    for rules in dict.fromkeys(scenario.rules_file for scenario in scenarios):
        supervisor.supervisor.build(rules=rules)
    with_images = [scenario for scenario in scenarios if scenario.sight is Sight.CAMERA]
    named = {(n, s.networks.get(n)): (s, n) for s in with_images for n in s.estimators}
    for scenario, name in named.values():
        _estimator(scenario, name)
    sensors = {scenario.leads_by for scenario in scenarios}
    if LeadSensor.CAMERA in sensors:
        perception.lead.finder.build()
    if LeadSensor.MODELLED in sensors:
        build_lead_model(seed=0)
    for user_sensor in {scenario.road_users_by for scenario in scenarios}:
        build_road_user_sensor(user_sensor, seed=0)
    if any(scenario.disturbances for scenario in scenarios):
        load_table()


class ClosedLoop:
    """One run: the vehicle and the camera around a :class:`Stack`, with the faults of the scenario."""

    def __init__(
        self,
        scenario: Scenario,
        parts: Parts,
        simulator: SimulatorSettings,
        witness: Witness | None = None,
        until: Until | None = None,
    ) -> None:
        self._scenario = scenario
        self._witness, self._until = witness, until
        self._parts = parts
        self._simulator = simulator
        self._stack = Stack(
            parts.supervisor,
            parts.controller,
            scenario.estimators,
            idle_period_s=simulator.idle_decision_period_s,
        )

    def drive(self) -> Trace:
        """Drive until the route or the duration is over. The trace begins at t = 0, after any run-up."""
        recorder, stack = Recorder(self._scenario.estimators), self._stack
        manoeuvres: list[tuple[str, ...]] = []
        user_gaps_m: list[float | None] = []
        period_s, parts = self._simulator.period_s, self._parts
        shot_due = due_ticks(period_s, 1.0 / self._scenario.camera.rate_hz)
        command_due = due_ticks(period_s, self._simulator.control_period_s)
        first = -round(self._simulator.run_up_s / period_s) if self._scenario.start.speed_mps else 0
        for tick in range(first, math.floor(self._scenario.duration_s / period_s + 0.5) + 1):
            now_s = tick * period_s
            lost = self._scenario.lost_processes(now_s)
            state, truth = parts.vehicle.step(stack.command, stack.commanded_s, now_s=now_s)
            shot = None
            if shot_due(tick) and "camera" not in lost:
                shot = parts.camera.shoot(truth, now_s=now_s)
                if shot is not None:
                    stack.send(self._perceive(shot, state, lost, now_s))
            stack.step(state, command_due=command_due(tick), now_s=now_s, lost=lost)
            now = self._instant(now_s, truth, state, shot)
            if self._witness is not None:
                self._witness(now)
            if tick >= 0:
                recorder.add(truth, state, stack.command, stack.decision, stack.estimates)
                manoeuvres.append(truth.manoeuvres)
                user_gaps_m.append(nearest_gap_m(parts.vehicle.box, parts.vehicle.road_users))
            if truth.finished or (self._until is not None and self._until(now)):
                break
        return with_events(
            recorder.trace(), self._scenario, parts.vehicle.road, manoeuvres, user_gaps_m=user_gaps_m
        )

    @property
    def waits_for(self) -> str:
        """What the car waits for by the newest decision; "" while it may drive."""
        return self._stack.decision.waits_for if self._stack.decision is not None else ""

    def _instant(
        self, now_s: float, truth: SimTruth, state: VehicleState, shot: FrameWithTruth | None
    ) -> Instant:
        stack = self._stack
        return Instant(
            now_s=now_s,
            truth=truth,
            state=state,
            frame=shot.frame if shot else None,
            sight=shot.sight if shot else None,
            estimates=stack.estimates,
            statistics=stack.statistics,
            lead=stack.lead,
            road_users=stack.road_users,
            decision=stack.decision,
            command=stack.command,
        )

    def _perceive(
        self, shot: FrameWithTruth, state: VehicleState, lost: Set[str], now_s: float
    ) -> Perception:
        """The results of the perception processes that run, for ``shot``."""
        parts, frame = self._parts, shot.frame
        if frame is not None:
            estimates = {
                n: e.step(frame, state, now_s=now_s) for n, e in parts.estimators.items() if n not in lost
            }
        else:
            estimates = {name: o.step(shot.truth) for name, o in parts.oracles.items() if name not in lost}
        return Perception(
            now_s + self._scenario.camera.latency_s,
            {name: self._falsify(name, estimate, now_s) for name, estimate in estimates.items()},
            self._judge(frame, state, now_s) if frame else clear_view(shot.truth.t_s, shot.sight),
            self._find_lead(shot, state, now_s) if "lead" not in lost else None,
            self._find_road_users(shot, lost),
        )

    def _judge(self, frame: Frame, state: VehicleState, now_s: float) -> ImageStatistics:
        """The judged image; the lane is the newest one of the first estimator, whose process judges the image."""
        lane = next(iter(self._stack.estimates.values()), None)
        return self._parts.judge.step(frame, lane, state, now_s=now_s)

    def _find_lead(self, shot: FrameWithTruth, state: VehicleState, now_s: float) -> LeadVehicle | None:
        """The vehicle ahead; the detector uses the lanes of earlier frames, as a process of its own does."""
        match self._parts.lead:
            case LeadFinder() as finder:
                lanes = self._stack.estimates.values()
                return finder.step(shot.frame, state, lanes, now_s=now_s) if shot.frame else None
            case LeadModel() as model:
                sight, within_m = shot.sight, math.inf
                if sight is not None and sight.cause:  # a vehicle that ends the sight itself is seen
                    seen_m = sight.distance_m + VEHICLE_M * (sight.cause == Cause.OCCLUDED)
                    within_m = seen_m - self._parts.vehicle.nose_m
                return model.step(self._parts.vehicle.sense_lead(), within_m=within_m)
        return self._parts.vehicle.sense_lead()

    def _find_road_users(self, shot: FrameWithTruth, lost: Set[str]) -> RoadUsers | None:
        """The people, cyclists and animals; those of the detector are of its last frame, that of the lead."""
        parts = self._parts
        if parts.road_user_sensor is not None and isinstance(parts.vehicle, SimulatedVehicle):
            return parts.road_user_sensor.step(parts.vehicle, shot.sight)
        if not isinstance(parts.lead, LeadFinder) or shot.frame is None or "lead" in lost:
            return None
        return parts.lead.road_users

    def _falsify(self, name: str, estimate: SteeringEstimate, now_s: float) -> SteeringEstimate:
        """``estimate`` under the faults of the estimator ``name`` that are active."""
        wheelbase_m = self._parts.vehicle.wheelbase_m
        for fault in self._scenario.faults:
            if not isinstance(fault, EstimatorBias | LostLane) or fault.estimator not in (name, None):
                continue
            if fault.active(now_s):
                estimate = fault.falsify(estimate, wheelbase_m=wheelbase_m)
        return estimate


def due_ticks(period_s: float, every_s: float) -> Callable[[int], bool]:
    """A function of the tick: True for the first tick of each interval of ``every_s``."""
    spans = period_s / every_s
    return lambda tick: math.floor(tick * spans + 1e-6) > math.floor((tick - 1) * spans + 1e-6)
