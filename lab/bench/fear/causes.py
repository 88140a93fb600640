"""Rate and delay of the right cause: faults injected into rendered drives with the real estimators.

A trial is a drive along a marked road with the sudden onset of one fault. The cause in the decision at the first or
second frame after it counts, so the fear rules must hold, too. Strength, place and appearance of the fault are
random. Times are processor times.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

import perception.estimators
from perception.sight.judge import build as build_judge
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from supervisor.modes.analyser import analyse, traced_cause
from supervisor.rules.inference import CALM, FearRules
from supervisor.situation.world_state import WorldStateObserver
from supervisor.supervisor import SupervisorSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, ImageStatistics, LeadVehicle, SteeringEstimate, VehicleState
from trepid.types import Image

TRIALS = 40  # of each fault
WARM_UP, WITHIN = 10, 2  # frames
PERIOD_S, LATENCY_S, SPEED_MPS = 0.04, 0.03, 8.0
ESTIMATORS = ("cv", "cnn")
UNMARKED = {
    **{f"appearance.{line}.stroke": "none" for line in ("left", "right", "far_left")},
    **{f"appearance.paved_{side}_m": "0" for side in ("left", "right")},
}
FRONT_M = 2.2  # the front bumper before the rear axle
TARGET = 0.97
Rng = np.random.Generator


@dataclass(kw_only=True)
class FrameOutputs:
    """Outputs of one frame; a fault changes them."""

    image: Image
    past: list[Image]  # former frames
    frame: bool = True  # False: the camera sends nothing
    silent: str = ""  # name of a silent estimator
    lead_m: float | None = None
    bias_m: Mapping[str, float] | None = None  # per estimator, of the lateral offset


class Scene:
    """Renderers of one straight road, without and with faults."""

    def __init__(self, rng: Rng) -> None:
        self._camera = load(CONFIG_DIR / "camera.yaml", Camera)
        self._seed = int(rng.integers(2**31))
        self._renderers: dict[str, Renderer] = {}
        self.station_m = float(rng.uniform(20, 300))
        self._aside_m = float(rng.uniform(-0.15, 0.15))

    def image(self, number: int, kind: str = "", **options: Any) -> Image:
        """Frame ``number`` of the drive; ``kind`` names a disturbance, "unmarked", or nothing."""
        grade = options.pop("grade", 0.0)
        if kind not in self._renderers:
            self._renderers[kind] = self._renderer(kind, grade)
        renderer = self._renderers[kind]
        yaw_rad = options.pop("yaw_rad", 0.0)
        station_m = self.station_m + SPEED_MPS * PERIOD_S * number
        x_m, y_m = renderer.road.position(station_m, self._aside_m)
        return renderer.render(
            x_m,
            y_m,
            renderer.road.heading_at(station_m) + yaw_rad,
            station_m=station_m,
            t_s=PERIOD_S * number,
            motion=ShutterMotion(SPEED_MPS, 0.0),
            vehicles=[self._vehicle(renderer, station_m, ahead_m) for ahead_m in options.pop("ahead_m", ())],
        )

    def _renderer(self, kind: str, grade: float) -> Renderer:
        changes = UNMARKED if kind == "unmarked" else {}
        road = load_scenario("straight", changes).build_road()
        spoiled = [Disturbance(kind=DisturbanceKind(kind), grade=grade)] if grade else []
        return Renderer(road, self._camera, seed=self._seed, disturbances=spoiled)

    @staticmethod
    def _vehicle(renderer: Renderer, station_m: float, ahead_m: float) -> tuple[Pose, Body]:
        body = Body(width_m=2.5, height_m=3.6, waist_m=3.0)  # a lorry
        x_m, y_m = renderer.road.position(station_m + ahead_m - body.rear_m, 0.0)
        return (x_m, y_m, renderer.road.heading_at(station_m)), body


Fault = Callable[[FrameOutputs, Scene, int, Rng], FrameOutputs]


def _dark(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    light = rng.choice([0.0, 0.03, 0.08])
    return replace(now, image=_noisy(now.image * light, rng))


def _over_expose(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=_noisy(now.image * rng.uniform(3.0, 8.0), rng))


def _freeze(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=now.past[-1])


def _loop(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=now.past[-2])


def _blur(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=cv2.GaussianBlur(now.image, (0, 0), rng.uniform(8, 14)).astype(np.uint8))


def _dirty(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=scene.image(number, "dirt", grade=4.0))


def _occlude(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    lead_m = rng.uniform(6.5, 8.0)
    return replace(now, image=scene.image(number, ahead_m=(lead_m + FRONT_M,)), lead_m=lead_m)


def _remove_marks(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=scene.image(number, "unmarked"))


def _no_road(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, image=scene.image(number, yaw_rad=1.6))


def _lost(estimator: str) -> Fault:
    return lambda now, scene, number, rng: replace(now, silent=estimator)


def _stale(now: FrameOutputs, scene: Scene, number: int, rng: Rng) -> FrameOutputs:
    return replace(now, frame=False)


def _lying(estimator: str) -> Fault:
    return lambda now, scene, number, rng: replace(now, bias_m={estimator: rng.uniform(0.6, 1.0)})


FAULTS: dict[str, tuple[str, Fault]] = {
    "no light": ("dark", _dark),
    "far too much light": ("over_exposed", _over_expose),
    "one image again and again": ("frozen_camera", _freeze),
    "two images by turns": ("frozen_camera", _loop),
    "out of focus": ("blurred", _blur),
    "mud on the lens": ("dirty_lens", _dirty),
    "a lorry close ahead": ("occluded", _occlude),
    "the lines end": ("unmarked", _remove_marks),
    "facing the field": ("no_road", _no_road),
    "cv silent": ("lost_estimator", _lost("cv")),
    "cnn silent": ("lost_estimator", _lost("cnn")),
    "no frames": ("stale_data", _stale),
    "cv lies": ("disagreement", _lying("cv")),
    "cnn lies": ("disagreement", _lying("cnn")),
}
"""Name -> the right cause, and the fault."""


class Watcher:
    """Estimators, image statistics and the supervisor up to its cause."""

    def __init__(self) -> None:
        settings = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
        vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        self._rules = FearRules.load(CONFIG_DIR / "fear.yaml")
        self._settings = settings.analyser
        self._observer = WorldStateObserver(
            *(settings.validation, settings.fusion, settings.follow, settings.giving_way, settings.sight),
            vehicle,
        )
        self._estimators = {name: perception.estimators.build(name) for name in ESTIMATORS}
        self._judge = build_judge()
        self._seen: dict[str, SteeringEstimate | None] = dict.fromkeys(ESTIMATORS)
        self._statistics: ImageStatistics | None = None
        self.spent_us: list[float] = []  # for the analysis alone ...
        self.looked_us: list[float] = []  # ... and for the image statistics

    def step(self, moment: FrameOutputs, *, t_s: float) -> str:
        """The cause at the arrival of the frame captured at ``t_s``."""
        state = VehicleState(
            t_s=t_s + LATENCY_S - 0.01,
            speed_mps=SPEED_MPS,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=0.0,
            driver_override=False,
        )
        if moment.frame:
            self._look(moment, state, t_s)
        lead = LeadVehicle(
            t_s=t_s,
            distance_m=moment.lead_m,
            lateral_m=None if moment.lead_m is None else 0.0,
            speed_mps=None if moment.lead_m is None else SPEED_MPS,
            confidence=0.0 if moment.lead_m is None else 1.0,
        )
        world = self._observer.step(
            self._rules, self._seen, self._statistics, lead, state, now_s=t_s + LATENCY_S
        )
        rated = self._rules.evaluate(world.features)
        started_s = time.thread_time()
        finding = analyse(world.features, self._settings, ages_s=world.ages_s)
        self.spent_us.append(1e6 * (time.thread_time() - started_s))
        return CALM if rated.cause == CALM else traced_cause(rated.cause, finding)

    def _look(self, moment: FrameOutputs, state: VehicleState, t_s: float) -> None:
        frame = Frame(t_s=t_s, image=moment.image)
        started_s = time.thread_time()
        self._statistics = self._judge.step(frame, self._seen[ESTIMATORS[0]], state, now_s=t_s)
        self.looked_us.append(1e6 * (time.thread_time() - started_s))
        for name, estimator in self._estimators.items():
            if name == moment.silent:
                continue
            estimate = estimator.step(frame, state, now_s=t_s)
            bias_m = (moment.bias_m or {}).get(name, 0.0)
            if estimate.lateral_offset_m is not None and bias_m:
                estimate = replace(estimate, lateral_offset_m=estimate.lateral_offset_m + bias_m)
            self._seen[name] = estimate


def trial(fault: Fault | None, rng: Rng, watcher: Watcher) -> list[str]:
    """The causes of the frames after the fault begins, or of as many frames without a fault."""
    scene = Scene(rng)
    past: list[Image] = []
    causes: list[str] = []
    seed = int(rng.integers(2**31))
    for number in range(WARM_UP + WITHIN):
        moment = FrameOutputs(image=scene.image(number), past=past)
        if fault is not None and number >= WARM_UP:
            moment = fault(
                moment, scene, number, np.random.default_rng(seed)
            )  # the same random numbers for every frame
        cause = watcher.step(moment, t_s=PERIOD_S * number)
        past.append(moment.image)
        if number >= WARM_UP:
            causes.append(cause)
    return causes


def bench_causes(seed: int) -> dict[str, Any]:
    """Share of trials with the right cause within two frames for every fault, causes without a fault, and times."""
    cv2.setNumThreads(1)
    rows: dict[str, Any] = {}
    spent_us: list[float] = []
    looked_us: list[float] = []
    right = 0
    for name, (cause, fault) in FAULTS.items():
        found: list[list[str]] = []
        for rng in _lots(seed, name):
            watcher = Watcher()
            found.append(trial(fault, rng, watcher))
            spent_us += watcher.spent_us[3:]
            looked_us += watcher.looked_us[3:]
        hits = sum(cause in causes for causes in found)
        right += hits
        rows[f"{name}: {cause}"] = _row(hits, [causes[-1] for causes in found if cause not in causes])
    calm = [trial(None, rng, Watcher()) for rng in _lots(seed, "none")]
    rows["nothing: none"] = _row(
        sum(set(causes) == {CALM} for causes in calm), [c for causes in calm for c in causes if c != CALM]
    )
    share = right / (TRIALS * len(FAULTS))
    return rows | {
        "right causes": f"{100 * share:.1f} %, target {100 * TARGET:.0f} %",
        "analyser": _times(spent_us),
        "image statistics": _times(looked_us) + ", target 300 us",
    }


def _lots(seed: int, name: str) -> Iterator[Rng]:
    for number in range(TRIALS):
        yield np.random.default_rng([seed, number, *name.encode()])


def _row(hits: int, others: list[str]) -> str:
    wrong = ", ".join(f"{cause} {others.count(cause)}" for cause in sorted(set(others)))
    return f"{hits} of {TRIALS}" + (f"; else {wrong}" if wrong else "")


def _times(times_us: list[float]) -> str:
    median, p99 = np.percentile(times_us, [50, 99])
    return f"{median:.1f} us median, {p99:.1f} us p99"


def _noisy(light: Any, rng: Rng) -> Image:
    """Sensor noise of one grey level on top, so that no two frames are equal."""
    return np.asarray(np.clip(light + rng.normal(0, 1.0, light.shape), 0, 255), np.uint8)
