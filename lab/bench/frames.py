"""Time of a frame: rendered, without and with each disturbance, and processed by the estimators."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Any

import cv2
import numpy as np

from lab.bench.commits.paired import against_commit
from perception.estimators import ESTIMATORS, build
from perception.net.session import open_session
from perception.segments.settings import network_description, network_file, segment_settings
from perception.sight.judge import build as build_judge
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Array, Image

SPEED_MPS = 8.0
FRAME_PERIOD_S = 0.04
BENCH_FRAMES = 40
UNMARKED = "unmarked"  # name of the section of the circuit without paint
SEGMENTS, BARE = "segments", "segments, bare session"
SEGMENT_FRAMES, SEGMENT_RATE_HZ = 100, 15


def bench_estimators() -> dict[str, Any]:
    """Time per 320×240 frame of every estimator and of the judge of the image, one thread, and of the plain chain.

    The frames of the unmarked section of the lap have a row of their own, too; `segments` is beside its network.
    """
    cv2.setNumThreads(1)
    estimators = {name: build(name) for name in ESTIMATORS}
    judge = build_judge()
    lane: SteeringEstimate | None = None  # of the frame before, by the first estimator
    times_s: dict[str, list[float]] = {}
    for frame, state, part, _ in lap():
        time_s = time_call(judge.step, frame, lane, state, now_s=frame.t_s)
        times_s.setdefault("image_statistics", []).append(time_s)
        lanes: list[SteeringEstimate] = []
        for name, estimator in estimators.items():
            started_s = time.perf_counter()
            lanes.append(estimator.step(frame, state, now_s=frame.t_s))
            time_s = time.perf_counter() - started_s
            for row in (name, f"{name}, {part}") if part == UNMARKED else (name,):
                times_s.setdefault(row, []).append(time_s)
        lane = lanes[0]
        times_s.setdefault("bare_canny_chain", []).append(time_call(bare_canny_chain, frame.image))
    peer_s = float(np.median(times_s["bare_canny_chain"]))
    return {
        name: {**summary_ms(times), "ratio_to_bare_chain": round(float(np.median(times)) / peer_s, 2)}
        for name, times in times_s.items()
    } | bench_segments()


def bench_segments(frames: int = SEGMENT_FRAMES) -> dict[str, Any]:
    """Times of `segments` on the first frames of the lap, and of the bare session of its network on the same.

    Both take turns, and the first of a frame alternates. The ratio and the share of a core are those of processor
    times, in which other programs count least. Without the network a row says so. Raises InputError.
    """
    settings = segment_settings()
    try:
        path = network_file(settings)
    except InputError as error:
        return {SEGMENTS: {"not_measured": str(error)}}
    taken = network_description(settings.network).input
    session, estimator = open_session(path), build(SEGMENTS)
    times_s: dict[str, list[tuple[float, float]]] = {SEGMENTS: [], BARE: []}  # on the clock, of the processor
    for number, (frame, state, *_) in enumerate(islice(lap(), frames)):
        pixels = cv2.dnn.blobFromImage(frame.image, 1 / 255, (taken.width, taken.height))
        calls: list[tuple[str, Callable[[], object]]] = [
            (SEGMENTS, partial(estimator.step, frame, state, now_s=frame.t_s)),
            (BARE, partial(session.run, None, {taken.name: pixels})),
        ]
        for name, call in calls[:: -1 if number % 2 else 1]:
            began_s, used_s = time.perf_counter(), time.process_time()
            call()
            times_s[name].append((time.perf_counter() - began_s, time.process_time() - used_s))
    bare_s = np.median(times_s[BARE], axis=0)[1]
    return {name: _beside_session(np.array(times), float(bare_s)) for name, times in times_s.items()}


def _beside_session(times_s: Array, bare_s: float) -> dict[str, float]:
    """The row of ``times_s``, on the clock and of the processor, beside the bare session's processor time."""
    on_clock_s, used_s = times_s.T
    return {
        **summary_ms(list(on_clock_s)),
        "processor_ms": round(1e3 * float(np.median(used_s)), 3),
        "ratio_to_session": round(float(np.median(used_s)) / bare_s, 2),
        f"core_share_at_{SEGMENT_RATE_HZ}_hz": round(float(np.mean(used_s)) * SEGMENT_RATE_HZ, 3),
    }


def bare_canny_chain(image: Image) -> object:
    """The review's canonical chain, the peer: lower half, grey, Gauss, Canny, probabilistic Hough."""
    grey = cv2.GaussianBlur(cv2.cvtColor(image[image.shape[0] // 2 :], cv2.COLOR_BGR2GRAY), (5, 5), 0)
    return cv2.HoughLinesP(cv2.Canny(grey, 50, 150), 1, np.pi / 180, 20, minLineLength=20, maxLineGap=10)


def bench_renderer(against: str = "") -> dict[str, Any]:
    """Frames per second of the renderer over a lap of the circuit, painting of the ground included.

    ``against`` a commit: the time of a frame beside that of the commit instead.
    """
    if against:
        return against_commit("frame", against)
    cv2.setNumThreads(1)
    started_s = time.process_time()
    times_s = [time_s for *_, time_s in lap()]
    used_s = time.process_time() - started_s
    result: dict[str, Any] = {**summary_ms(times_s), "frames_per_s": round(1 / float(np.mean(times_s)), 1)}
    result["frames_per_processor_s"] = round(len(times_s) / used_s, 1)
    return result | bench_disturbances()


def bench_disturbances() -> dict[str, Any]:
    """Processor time of a frame at grades 3 and 5 of every disturbance, on painted ground, relative to one without.

    Frames with and without take turns, so that both are measured under the same load.
    """
    road = load_scenario("circuit").build_road()
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    ground = Ground(road, seed=0)
    plain = Renderer(road, camera, seed=0, ground=ground)
    ratios: dict[str, Any] = {}
    for kind in DisturbanceKind:
        for grade in (3, 5):
            disturbance = Disturbance(kind=kind, grade=grade)
            disturbed = Renderer(road, camera, seed=0, ground=ground, disturbances=[disturbance])
            times_s = np.array([_side_by_side(plain, disturbed, i) for i in range(BENCH_FRAMES)])
            without_s, with_s = np.median(times_s, axis=0)
            ratios[f"{kind} {grade}"] = f"{1e3 * with_s:.2f} ms, ratio {with_s / without_s:.2f}"
    return ratios


def _side_by_side(plain: Renderer, disturbed: Renderer, frame: int) -> tuple[float, float]:
    """Processor times of the same frame without and with a disturbance [s], on painted ground."""
    road, t_s = plain.road, frame * FRAME_PERIOD_S
    station_m = 20.0 + SPEED_MPS * t_s
    x_m, y_m = road.position(station_m, 0.0)
    yaw_rad, motion = road.heading_at(station_m), ShutterMotion(SPEED_MPS, 0.1)
    plain.render(x_m, y_m, yaw_rad, t_s=t_s, station_m=station_m)
    clock_s = [time.process_time()]
    for renderer in (plain, disturbed):
        renderer.render(x_m, y_m, yaw_rad, t_s=t_s, station_m=station_m, motion=motion)
        clock_s.append(time.process_time())
    return clock_s[1] - clock_s[0], clock_s[2] - clock_s[1]


def lap() -> Iterator[tuple[Frame, VehicleState, str, float]]:
    """The frames of a lap at 8 m/s, the state of the vehicle, the part of the road, and its drawing time [s]."""
    road = load_scenario("circuit").build_road()
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=0)
    for i in range(int(road.length_m / (SPEED_MPS * FRAME_PERIOD_S))):
        t_s = i * FRAME_PERIOD_S
        station_m = SPEED_MPS * t_s
        x_m, y_m = road.position(station_m, 0.0)
        started_s = time.perf_counter()
        image = renderer.render(x_m, y_m, road.heading_at(station_m), station_m=station_m, t_s=t_s)
        time_s = time.perf_counter() - started_s
        state = VehicleState(
            t_s=t_s,
            speed_mps=SPEED_MPS,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=SPEED_MPS * road.curvature_at(station_m),
            driver_override=False,
        )
        yield Frame(t_s=t_s, image=image), state, road.section_at(station_m).name, time_s


def summary_ms(times_s: list[float]) -> dict[str, float]:
    """Median and 99th percentile [ms] of times [s]."""
    p50, p99 = np.percentile(times_s, [50, 99]) * 1e3
    return {"median_ms": round(float(p50), 3), "p99_ms": round(float(p99), 3)}


def time_call(call: Callable[..., object], *args: object, **kwargs: object) -> float:
    """Wall-clock time of one call [s]."""
    started_s = time.perf_counter()
    call(*args, **kwargs)
    return time.perf_counter() - started_s
