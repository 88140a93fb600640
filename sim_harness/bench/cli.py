"""Benchmarks: what each part costs, beside a peer in the same run, with machine, load and versions.

Runs of ours and of the peer take turns on the same frames, so that a machine that slows down slows both; quote the
medians and the ratios.
"""

import importlib.metadata
import json
import os
import platform
import secrets
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console

from perception.camera.image_statistics import ImageStatistician
from perception.estimators import ESTIMATORS, build
from sim_harness.bench.control.bench import SECTIONS, bench_control
from sim_harness.bench.control.limits import bench_limits
from sim_harness.bench.control.random_cases import bench_random
from sim_harness.bench.fear.bench import SECTIONS as FEAR_SECTIONS
from sim_harness.bench.fear.bench import bench_fear
from sim_harness.bench.follow.bench import FOLLOW_SECTIONS, bench_follow
from sim_harness.bench.lockstep import bench_lockstep
from sim_harness.bench.perception.bench import Wish, bench_perception
from sim_harness.bench.perception.report import brief
from sim_harness.bench.perception.watch import bare_canny_chain
from sim_harness.bench.plants import bench_plants
from sim_harness.bench.seeds import bench_seeds
from sim_harness.bench.sweep import bench_determinism, bench_sweep
from sim_harness.bench.text import tables
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.view import Motion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, VehicleState

SPEED_MPS = 8.0
FRAME_PERIOD_S = 0.04
UNMARKED = "unmarked"  # the part of the circuit without paint
BENCH_FRAMES = 40
LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "eclipse-zenoh")


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    return {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load_average": [round(load_, 2) for load_ in os.getloadavg()],
        "versions": {name: importlib.metadata.version(name) for name in LIBRARIES},
    }


def summary_ms(times_s: list[float]) -> dict[str, float]:
    """Median and 99th percentile [ms]."""
    p50, p99 = np.percentile(times_s, [50, 99]) * 1e3
    return {"median_ms": round(float(p50), 3), "p99_ms": round(float(p99), 3)}


def timed(call: Callable[..., object], *args: object, **kwargs: object) -> float:
    """Wall-clock time of one call [s]."""
    started_s = time.perf_counter()
    call(*args, **kwargs)
    return time.perf_counter() - started_s


def bench_renderer() -> dict[str, Any]:
    """Frames per second of the renderer over a lap of the circuit, painting of the world included."""
    cv2.setNumThreads(1)
    started_s = time.process_time()
    times_s = [time_s for *_, time_s in lap()]
    used_s = time.process_time() - started_s
    result: dict[str, Any] = {**summary_ms(times_s), "frames_per_s": round(1 / float(np.mean(times_s)), 1)}
    result["frames_per_processor_s"] = round(len(times_s) / used_s, 1)
    return result | bench_disturbances()


def bench_disturbances() -> dict[str, Any]:
    """Processor time of a frame at grades 3 and 5 of every disturbance, on painted ground, relative to one without.

    Frames with and without take turns, so that both see the same load.
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
    """Processor times of the same frame without and with a disturbance [s], on ground that is painted."""
    road, t_s = plain.road, frame * FRAME_PERIOD_S
    station_m = 20.0 + SPEED_MPS * t_s
    x_m, y_m = road.position(station_m, 0.0)
    yaw_rad, motion = road.heading_at(station_m), Motion(SPEED_MPS, 0.1)
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


def bench_estimators() -> dict[str, Any]:
    """Time per 320×240 frame of every estimator and the image statistics, one thread, beside the bare chain.

    The frames of the unmarked part of the lap are told once more by themselves.
    """
    cv2.setNumThreads(1)
    estimators = {name: build(name) for name in ESTIMATORS}
    statistician = ImageStatistician()
    times_s: dict[str, list[float]] = {}
    for frame, state, part, _ in lap():
        for name, estimator in estimators.items():
            time_s = timed(estimator.step, frame, state, now_s=frame.t_s)
            for row in (name, f"{name}, {part}") if part == UNMARKED else (name,):
                times_s.setdefault(row, []).append(time_s)
        times_s.setdefault("image_statistics", []).append(timed(statistician.step, frame, now_s=frame.t_s))
        times_s.setdefault("bare_canny_chain", []).append(timed(bare_canny_chain, frame.image))
    peer_s = float(np.median(times_s["bare_canny_chain"]))
    return {
        name: {**summary_ms(times), "ratio_to_bare_chain": round(float(np.median(times)) / peer_s, 2)}
        for name, times in times_s.items()
    }


BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {
    "estimators": bench_estimators,
    "renderer": bench_renderer,
    "lockstep": bench_lockstep,
    "plants": bench_plants,
    "sweep": bench_sweep,
    "determinism": bench_determinism,
}
SEEDED: dict[str, Callable[[int], dict[str, Any]]] = {
    "control": bench_control,
    **{f"control-{name}": section for name, section in SECTIONS.items()},
    "control-limits": bench_limits,
    "control-random": bench_random,
    "fear": bench_fear,
    **{f"fear-{name}": section for name, section in FEAR_SECTIONS.items()},
    "follow": bench_follow,
    **{f"follow-{name}": section for name, section in FOLLOW_SECTIONS.items()},
    "seeds": bench_seeds,
}
"""Benchmarks that draw lots."""
PERCEPTION = "perception"  # has options of its own
KNOWN = (*BENCHMARKS, PERCEPTION, *SEEDED)
ON_REQUEST = {"determinism", PERCEPTION, *SEEDED}  # takes minutes


def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(help=f"Any of {', '.join(KNOWN)}; default: all but {', '.join(sorted(ON_REQUEST))}."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Replay the lots of a run; default: fresh ones.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    estimators: Annotated[
        str, typer.Option(help="perception: which, with commas between; default: all.")
    ] = "",
    quick: Annotated[bool, typer.Option(help="perception: a seventh of the set.")] = False,
    repeats: Annotated[int, typer.Option(min=1, help="perception: how many times the set.")] = 1,
    jobs: Annotated[int, typer.Option(min=1, help="perception: processes.")] = 1,
    keep_frames: Annotated[
        bool, typer.Option(help="perception: keep the frames (0.7 GB), so that they are drawn once a seed.")
    ] = False,
    parts: Annotated[
        str, typer.Option(help="perception: what to do, with commas between: set, real, drive.")
    ] = "set,real",
    data: Annotated[
        Path | None, typer.Option(help="perception: the real sets; default: TREPID_DATA, ../shared/data.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="perception: a folder for tables and figures.")] = None,
) -> int:
    """Measure what each part costs, beside a peer in the same run."""
    for name in names or []:
        if name not in KNOWN:
            raise InputError(f"no benchmark {name!r}; there are {', '.join(KNOWN)}")
    seed = secrets.randbits(32) if seed is None else seed
    wish = Wish(
        seed=seed,
        estimators=_listed(estimators),
        quick=quick,
        repeats=repeats,
        jobs=jobs,
        keep_frames=keep_frames,
        out=out,
        data=data,
        parts=_listed(parts),
    )
    if PERCEPTION not in (names or []) and wish != Wish(seed=seed):
        raise InputError(
            "--estimators, --quick, --repeats, --jobs, --keep-frames, --parts, --data, --out are for perception"
        )
    result: dict[str, Any] = machine() | {"seed": seed}
    for name in names or [name for name in BENCHMARKS if name not in ON_REQUEST]:
        typer.echo(f"bench {name} ...", err=True)
        if name == PERCEPTION:
            found = bench_perception(wish)
            result |= found if as_json else brief(found)
        else:
            result[name] = SEEDED[name](seed) if name in SEEDED else BENCHMARKS[name]()
    if as_json:
        print(json.dumps(result))
        return 0
    console = Console()
    for table in tables(result):
        console.print(table, "")
    return 0


def _listed(text: str) -> tuple[str, ...]:
    """Names with commas between."""
    return tuple(part.strip() for part in text.split(",") if part.strip())
