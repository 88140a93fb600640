"""One drive on rails under one stress: fear without consequences, and its causes.

The car follows the true lane at a constant speed, so that neither slowing down nor leaving the lane hides what
fear would be. Images, estimators, image statistics and the supervisor are those of every run.
"""

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from lab.bench.severity.stresses import Stress, stress_of
from perception.estimators import Estimator
from sim_harness.lockstep.camera import Pictures
from sim_harness.lockstep.closed_loop import ClosedLoop, Instant, Parts, build_parts
from sim_harness.lockstep.oracle import Oracle
from sim_harness.lockstep.unsupervised import Estimates, FollowedLane, UnsupervisedDriver
from sim_harness.lockstep.vehicle import SimulatorSettings, load_simulator
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.store import Row
from supervisor.modes.analyser import AnalyserSettings, analyse, traced_cause
from supervisor.rules.inference import CALM, FearRules
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, default_file, load
from trepid.messages import (
    Decision,
    Frame,
    SimTruth,
    SteeringEstimate,
    VehicleState,
)
from trepid.types import Image

RUN_UP_S = 1.2  # under the same disturbance; the jitter of estimates is measured over half a second
BEGIN_S, END_S = (
    0.4,
    2.0,
)  # of the window, from the start of the run: two periods of the faults that come and go
BEND_MPS2, LEAST_RADIUS_M = 1.5, 60.0  # lateral acceleration of the bend
BEHIND_M, AHEAD_M = 10.0, 150.0  # of road
WORST = 95  # percentile


class StressedDrive(NamedTuple):
    """One drive."""

    stress: str
    grade: int
    road: str  # straight or bend
    speed_mps: float
    seed: int

    @property
    def key(self) -> str:
        """Unique key of the drive."""
        return f"{self.stress} {self.grade} {self.road} {self.speed_mps:g} {self.seed}"


class RememberedEstimator:
    """An estimator whose estimates of one drive are used again in the next one.

    On rails the images of two drives are equal, bit for bit, if only what follows perception differs.
    """

    def __init__(self, estimator: Estimator, estimates: dict[float, SteeringEstimate]) -> None:
        self._estimator, self._estimates = estimator, estimates

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate for ``frame``, computed once."""
        if frame.t_s not in self._estimates:
            self._estimates[frame.t_s] = self._estimator.step(frame, state, now_s=now_s)
        return self._estimates[frame.t_s]


class RecallingRenderer:
    """A renderer whose images of one drive are used again."""

    def __init__(self, renderer: Pictures, images: dict[float, Image]) -> None:
        self._renderer, self._images = renderer, images
        self.seed, self.road = renderer.seed, renderer.road

    def render(self, *pose: float, t_s: float, **view: Any) -> Image:
        """The image at ``t_s``."""
        if t_s not in self._images:
            self._images[t_s] = self._renderer.render(*pose, t_s=t_s, **view)
        return self._images[t_s]


@lru_cache(maxsize=1)
def _memory(road: str, speed_mps: float, seed: int) -> Mapping[str, dict[float, Any]]:
    """Images and estimates of the undisturbed drive: by name, and by time of the frame."""
    return defaultdict(dict)


class Rails:
    """The true lane, and the vehicle state that the supervisor of its driver gets, which may be wrong."""

    def __init__(self, stress: Stress, task: StressedDrive, oracle: Oracle) -> None:
        self._oracle = oracle
        self._truth: SimTruth | None = None
        self._delay_s = stress.state_delay_s * task.grade
        self._bias_radps = stress.yaw_bias_radps * task.grade
        self._states: list[VehicleState] = []

    def see(self, truth: SimTruth) -> None:
        """Note the true place of the car."""
        self._truth = truth

    def report(self, state: VehicleState | None, now_s: float) -> VehicleState | None:
        """The state of the car under the stress: old, or with a wrong yaw rate."""
        if state is None or now_s < 0.0 or not (self._delay_s or self._bias_radps):
            return state
        self._states.append(state)
        while len(self._states) > 1 and self._states[1].t_s <= now_s - self._delay_s:
            self._states.pop(0)
        old = self._states[0]
        yaw_radps = None if old.yaw_rate_radps is None else old.yaw_rate_radps + self._bias_radps
        return replace(old, yaw_rate_radps=yaw_radps)

    def lane(self, _: Decision, __: Estimates) -> FollowedLane | None:
        """The true lane from the noted place."""
        truth = self._truth
        return None if truth is None else FollowedLane.of(self._oracle.step(truth), truth.t_s)


def scenario_of(task: StressedDrive) -> Scenario:
    """The scenario of a drive: a marked road of one curvature under the stress."""
    start_m = BEHIND_M + RUN_UP_S * task.speed_mps
    middle_m = start_m + (BEGIN_S + END_S) / 2 * task.speed_mps
    radius_m = max(LEAST_RADIUS_M, task.speed_mps**2 / BEND_MPS2)
    segment = {
        "length_m": start_m + END_S * task.speed_mps + AHEAD_M,
        "curvature_1pm": 1 / radius_m if task.road == "bend" else 0.0,
    }
    return Scenario.model_validate(
        {
            "name": "severity",
            "description": task.key,
            "tags": ["weather"],
            "road": "straight",
            "segments": [segment],
            "start": {"station_m": start_m, "speed_mps": task.speed_mps},
            "speed_mps": task.speed_mps,
            "duration_s": END_S,
            **stress_of(task.stress).changes(task.grade, middle_m),
        }
    )


def parts_of(task: StressedDrive, scenario: Scenario) -> tuple[Parts, Oracle]:
    """The nodes of the drive, and the true lane."""
    parts = build_parts(scenario, seed=task.seed, simulator=_simulator())
    stress, memory = stress_of(task.stress), _memory(task.road, task.speed_mps, task.seed)
    if stress.behind_camera and parts.camera.renderer is not None:
        pictures: Any = RecallingRenderer(parts.camera.renderer, memory["images"])
        parts.camera.renderer = pictures
    if stress.behind_perception:
        estimators = {name: RememberedEstimator(e, memory[name]) for name, e in parts.estimators.items()}
        parts = replace(parts, estimators=estimators, lead=None)  # no vehicle is ahead
    return parts, Oracle("truth", parts.vehicle.road, parts.vehicle.nominal)


@cache
def _simulator() -> SimulatorSettings:
    return load_simulator().model_copy(update={"run_up_s": RUN_UP_S})


@cache
def _rules() -> tuple[FearRules, AnalyserSettings]:
    settings = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
    return FearRules.load(default_file("fear.yaml")), settings.analyser


def cause_of(decision: Decision) -> str:
    """The cause of the present fear by the inputs in ``decision``, also where a stop keeps an earlier one."""
    rules, analyser = _rules()
    values = dict(zip(decision.inputs, decision.input_values, strict=True))
    cause = rules.evaluate(values).cause
    finding = analyse(values, analyser, ages_s={"": math.nan})
    return CALM if cause == CALM else traced_cause(cause, finding, decision.sight_cause)


def decisions_of(task: StressedDrive) -> list[Decision]:
    """The decisions in the window."""
    scenario = scenario_of(task)
    parts, oracle = parts_of(task, scenario)
    rails = Rails(stress_of(task.stress), task, oracle)
    driver = UnsupervisedDriver(
        parts.supervisor, "truth", rails.lane, cruise_speed_mps=task.speed_mps, report=rails.report
    )
    found: dict[float, Decision] = {}

    def watch(now: Instant) -> None:
        rails.see(now.truth)
        if now.decision is not None and now.decision.decided_s >= BEGIN_S:
            found[now.decision.decided_s] = now.decision

    railed = replace(parts, supervisor=driver)  # type: ignore[arg-type]
    ClosedLoop(scenario, railed, _simulator(), watch).drive()
    return list(found.values())


def driven_row(task: StressedDrive) -> Row:
    """Mean and 95th percentile of fear in the window, and how often each cause was named above very_low."""
    decisions = decisions_of(task)
    fears = np.array([d.fear for d in decisions])
    causes = [cause_of(d) for d in decisions if d.level != "very_low"]
    return {
        **task._asdict(),
        "mean": float(fears.mean()),
        "worst": float(np.percentile(fears, WORST)),
        "frames": len(fears),
        "causes": {cause: causes.count(cause) for cause in sorted(set(causes))},
    }
