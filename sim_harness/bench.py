"""Benchmarks: what each part costs, beside a peer in the same run, with machine, load and versions.

Runs of ours and of the peer take turns on the same frames, so that a machine that slows down slows both; quote the
medians and the ratios.
"""

import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Callable
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from perception.estimators import ESTIMATORS, build
from perception.image_statistics import ImageStatistician
from sim_harness.closed_loop import run
from sim_harness.renderer import Renderer
from sim_harness.scenarios import load_scenario
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, Image

FRAMES = 300
STEP_M = 3.0
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
    """Frames per second of the renderer along the circuit, world already painted."""
    times_s = [time_s for _, time_s in circuit_frames()]
    return {**summary_ms(times_s), "frames_per_s": round(1 / float(np.median(times_s)), 1)}


def circuit_frames() -> list[tuple[Image, float]]:
    """Frames along the circuit with the time that each took to render [s]."""
    road = load_scenario("circuit").build_road()
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=0)
    frames = []
    for i in range(FRAMES):
        station_m = (i * STEP_M) % road.length_m
        x_m, y_m = road.position(station_m, 0.0)
        started_s = time.perf_counter()
        image = renderer.render(x_m, y_m, road.heading_at(station_m), station_m=station_m, t_s=0.04 * i)
        frames.append((image, time.perf_counter() - started_s))
    return frames


def bare_canny_chain(image: Image) -> object:
    """The review's canonical chain, the peer: lower half, grey, Gauss, Canny, probabilistic Hough."""
    grey = cv2.GaussianBlur(cv2.cvtColor(image[image.shape[0] // 2 :], cv2.COLOR_BGR2GRAY), (5, 5), 0)
    return cv2.HoughLinesP(cv2.Canny(grey, 50, 150), 1, np.pi / 180, 20, minLineLength=20, maxLineGap=10)


def bench_perception() -> dict[str, Any]:
    """Time per 320×240 frame of every estimator and the image statistics, one thread, beside the bare chain."""
    cv2.setNumThreads(1)
    estimators = {name: build(name) for name in ESTIMATORS}
    statistician = ImageStatistician()
    times_s: dict[str, list[float]] = {}
    for i, (image, _) in enumerate(circuit_frames()):
        frame, now_s = Frame(t_s=0.04 * i, image=image), 0.04 * i
        for name, estimator in estimators.items():
            times_s.setdefault(name, []).append(timed(estimator.step, frame, None, now_s=now_s))
        times_s.setdefault("image_statistics", []).append(timed(statistician.step, frame, now_s=now_s))
        times_s.setdefault("bare_canny_chain", []).append(timed(bare_canny_chain, image))
    peer_s = float(np.median(times_s["bare_canny_chain"]))
    return {
        name: {**summary_ms(times), "ratio_to_bare_chain": round(float(np.median(times)) / peer_s, 2)}
        for name, times in times_s.items()
    }


def bench_lockstep() -> dict[str, Any]:
    """Real-time factor of the circuit in lock-step, with rendering and both estimators."""
    scenario = load_scenario("circuit").shortened(40.0)
    rows = [run(scenario, seed=seed).row() for seed in range(3)]
    return {"realtime_factor": round(float(np.median([row["realtime_factor"] for row in rows])), 2)}


BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {
    "perception": bench_perception,
    "renderer": bench_renderer,
    "lockstep": bench_lockstep,
}


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help=f"Any of {', '.join(BENCHMARKS)}; default: all.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> int:
    """Measure what each part costs, beside a peer in the same run."""
    for name in names or []:
        if name not in BENCHMARKS:
            raise InputError(f"no benchmark {name!r}; there are {', '.join(BENCHMARKS)}")
    result: dict[str, Any] = machine()
    for name in names or BENCHMARKS:
        typer.echo(f"bench {name} ...", err=True)
        result[name] = BENCHMARKS[name]()
    if as_json:
        print(json.dumps(result))
        return 0
    table = Table(box=None)
    table.add_column("what", style="dim")
    table.add_column("value")
    for key, value in result.items():
        rows = value.items() if isinstance(value, dict) else [("", value)]
        for part, number in rows:
            table.add_row(f"{key} {part}", str(number))
    Console().print(table)
    return 0
