"""A run as one image, from its trace: camera views, map of the driven path, and time series."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cockpit.footage.annotate import with_lane
from perception.estimators import build
from sim_harness.judging.trace import Trace
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.figure_style import FEAR_COLOURS
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Array, Image

SIZE_IN, DPI = (16.0, 11.2), 100
VIEWS = 8
WARM_UP_S, FRAME_EVERY = 1.5, 4  # of the estimator before a view: time, and samples between its frames
STRETCH = 10  # samples of the path with one colour
LABEL_SHARE = 0.03  # of the road's length: labels of nearer places stand below each other
FEAR_MAP = LinearSegmentedColormap.from_list("fear", FEAR_COLOURS)
MAX_ERROR_M, MAX_CURVATURE_1PM = 0.5, 0.08


def draw(scenario: Scenario, trace: Trace, path: Path, *, seed: int) -> None:
    """Write the run as an image: views of eight sections above, map and time series below. Raises InputError."""
    if scenario.world is not None:
        raise InputError(
            f"{path}: draws the simulated road, and scenario {scenario.name} has a world of its own"
        )
    road = scenario.build_road()
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=(6, 5))
    above, below = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    _views(above.subplots(2, VIEWS // 2).flat, road, trace, seed)
    grid = below.add_gridspec(1, 2, width_ratios=(1, 2))
    left, right = below.add_subfigure(grid[0]), below.add_subfigure(grid[1])
    _map(left.subplots(), road, trace)
    _time_series(right.subplots(4, sharex=True), trace)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written as an image") from error


def _views(panels: Iterable[Axes], road: Road, trace: Trace, seed: int) -> None:
    """Camera views with the lane of the CV estimator, one from each of eight sections, framed in fear's colour."""
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=seed)
    for axes, (section, sample) in zip(panels, _moments(trace, count=VIEWS), strict=True):
        image, estimate = _estimate_at(renderer, trace, sample)
        axes.imshow(with_lane(image, estimate)[..., ::-1])
        fear = float(trace["decision.fear"][sample])
        at_s = float(trace["t_s"][sample] - trace["t_s"][0])
        axes.set_title(
            f"{section}, {at_s:.1f} s: fear {fear:.2f}, confidence {estimate.confidence:.2f}", fontsize=10
        )
        axes.set_xticks([])
        axes.set_yticks([])
        axes.spines[:].set(color=_colour(fear), linewidth=3)


def _estimate_at(renderer: Renderer, trace: Trace, sample: int) -> tuple[Image, SteeringEstimate]:
    """The frame at ``sample`` and its estimate by an estimator that has processed the frames before it."""
    estimator, image, estimate = build("cv"), None, None
    first = int(np.searchsorted(trace["t_s"], trace["t_s"][sample] - WARM_UP_S))
    for i in range(sample - (sample - first) // FRAME_EVERY * FRAME_EVERY, sample + 1, FRAME_EVERY):
        x_m, y_m, yaw_rad, station_m, t_s = (
            float(trace[name][i]) for name in ("x_m", "y_m", "yaw_rad", "station_m", "t_s")
        )
        image = renderer.render(x_m, y_m, yaw_rad, station_m=station_m, t_s=t_s)
        state = VehicleState(
            t_s=t_s,
            speed_mps=float(trace["speed_mps"][i]),
            road_wheel_angle_rad=float(trace["road_wheel_angle_rad"][i]),
            yaw_rate_radps=float(trace["yaw_rate_radps"][i]),
            driver_override=False,
        )
        estimate = estimator.step(Frame(t_s=t_s, image=image), state, now_s=t_s)
    assert image is not None and estimate is not None  # the range holds at least ``sample``
    return image, estimate


def _moments(trace: Trace, *, count: int | None = None) -> list[tuple[str, int]]:
    """For each section the name and the sample of greatest fear; of equal ones that of greatest curvature.

    With ``count``, of so many sections; where there are fewer, the longest ones are divided in time, so that all
    moments differ.
    """
    rolling = trace["speed_mps"] >= 1.0
    sections = [
        (name, np.flatnonzero((trace["section"] == code) & (rolling | ~rolling.any())))
        for code, name in enumerate(trace.words["section"])
    ]
    pieces = [(name, samples) for name, samples in sections if len(samples)]
    while count is not None and len(pieces) < count and max(len(samples) for _, samples in pieces) > 1:
        longest = max(range(len(pieces)), key=lambda i: len(pieces[i][1]))
        name, samples = pieces[longest]
        pieces[longest : longest + 1] = [(name, half) for half in np.array_split(samples, 2)]
    moments = [(name, _telling(trace, samples)) for name, samples in pieces]
    if count is None:
        return moments
    return [moments[i] for i in np.linspace(0, len(moments) - 1, count).round().astype(int)]


def _telling(trace: Trace, samples: NDArray[np.intp]) -> int:
    """The sample of greatest fear; of equal ones that of greatest curvature, and of these the middle one."""
    fear = np.nan_to_num(trace["decision.fear"][samples], nan=1.0)
    samples = samples[fear >= fear.max() - 1e-6]
    bend_1pm = np.abs(trace["curvature_1pm"][samples])
    samples = samples[bend_1pm >= bend_1pm.max() - 1e-9]
    return int(samples[len(samples) // 2])


def _map(axes: Axes, road: Road, trace: Trace) -> None:
    """Bird's-eye view: the lane in grey, the driven path in the colour of fear."""
    stations_m = np.linspace(0.0, road.length_m, 2000)
    axes.plot(*road.positions(stations_m, np.zeros_like(stations_m)).T, color="lightgrey", linewidth=7)
    path = np.column_stack([trace["x_m"], trace["y_m"]])
    starts = range(0, len(path) - 1, STRETCH)
    stretches = [path[start : start + STRETCH + 1] for start in starts]
    fears = [float(np.max(trace["decision.fear"][start : start + STRETCH])) for start in starts]
    axes.add_collection(LineCollection(stretches, colors=[_colour(fear) for fear in fears], linewidths=2.5))
    axes.plot(*path[0], "o", color="black")
    middle = path.mean(axis=0)
    places: list[Array] = []  # of the labels so far
    for section, sample in _moments(trace):
        place = path[sample]
        below = sum(np.hypot(*(place - other)) < LABEL_SHARE * road.length_m for other in places)
        places.append(place)
        outwards = 1 if place[0] >= middle[0] else -1
        axes.annotate(
            section,
            place,
            xytext=(9 * outwards, 10 - 11 * below),
            textcoords="offset points",
            fontsize=8,
            ha="left" if outwards > 0 else "right",
            va="center",
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    axes.set_title(f"{road.length_m:.0f} m, path coloured by fear", fontsize=10)


def _time_series(panels: Iterable[Axes], trace: Trace) -> None:
    """Fear, speed, lateral error and curvature over time."""
    t_s = trace["t_s"] - trace["t_s"][0]
    rows = [
        ("fear", "decision.fear", (0.0, 1.0)),
        ("speed [m/s]", "speed_mps", (0.0, max(1.0, 1.1 * float(np.nanmax(trace["speed_mps"]))))),
        ("lateral error [m]", "lateral_offset_m", (-MAX_ERROR_M, MAX_ERROR_M)),
        ("curvature [1/m]", "curvature_1pm", (-MAX_CURVATURE_1PM, MAX_CURVATURE_1PM)),
    ]
    for axes, (title, name, limits) in zip(panels, rows, strict=True):
        axes.plot(t_s, np.clip(trace[name], *limits), linewidth=1.0)
        axes.set_ylim(*limits)
        axes.set_title(title, fontsize=10, loc="left")
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.4)
        axes.margins(x=0.0)
    axes.set_xlabel("time [s]", fontsize=9)


def _colour(fear: float) -> tuple[float, ...]:
    """Colour from green at fear 0 through yellow to red at 1; grey where unknown."""
    return FEAR_MAP(min(max(fear, 0.0), 1.0)) if np.isfinite(fear) else (0.6, 0.6, 0.6)
