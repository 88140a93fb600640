"""A run as one image, from its trace: camera views, map of the driven path, and time series."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.estimators import build
from perception.images.annotate import annotated
from sim_harness.judging.trace import Trace
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.road import Road
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Column, Image

WIDTH_PX, VIEW_PX, MAP_PX, PLOT_PX = 1600, 400, 520, 130
INK, PAPER, FAINT = (40, 40, 40), (250, 250, 250), (215, 215, 215)
WARM_UP_S, FRAME_EVERY = 1.5, 4  # of the estimator before a view: time, and samples between its frames
Points = NDArray[np.int32]


def draw(scenario: Scenario, trace: Trace, *, seed: int) -> Image:
    """The run as an image: camera views of eight sections above, map and timelines below."""
    road = scenario.build_road()
    below = np.hstack([_map(road, trace), _timelines(trace, WIDTH_PX - MAP_PX)])
    return np.vstack([_views(road, trace, seed), below])


def fear_colour(fear: float) -> tuple[int, int, int]:
    """Colour (BGR) from green at fear 0 through yellow to red at 1; grey where unknown."""
    if not np.isfinite(fear):
        return (160, 160, 160)
    hue = np.array([[[round(60 * (1 - min(max(fear, 0.0), 1.0))), 230, 200]]], np.uint8)
    blue, green, red = cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0].tolist()
    return blue, green, red


def _views(road: Road, trace: Trace, seed: int) -> Image:
    """Two rows of camera views with the lane of the CV estimator, one from each of eight sections."""
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    renderer, views = Renderer(road, camera, seed=seed), []
    for section, sample in _moments(trace, count=8):
        image, estimate = _estimated(renderer, trace, sample)
        view: Image = np.empty((VIEW_PX * 3 // 4, VIEW_PX, 3), np.uint8)
        cv2.resize(
            annotated(image, estimate), (VIEW_PX, VIEW_PX * 3 // 4), view, interpolation=cv2.INTER_AREA
        )
        fear = float(trace["decision.fear"][sample])
        cv2.rectangle(view, (0, VIEW_PX * 3 // 4 - 8), (VIEW_PX, VIEW_PX * 3 // 4), fear_colour(fear), -1)
        _text(view, f"{section}: fear {fear:.2f}", (8, VIEW_PX * 3 // 4 - 18), PAPER, scale=0.5)
        views.append(view)
    return np.vstack([np.hstack(views[:4]), np.hstack(views[4:])])


def _estimated(renderer: Renderer, trace: Trace, sample: int) -> tuple[Image, SteeringEstimate]:
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


def _moments(trace: Trace, *, count: int) -> list[tuple[str, int]]:
    """For ``count`` sections the name and the sample of greatest fear; of equal ones that of greatest curvature."""
    moments = []
    rolling = trace["speed_mps"] >= 1.0
    for code, name in enumerate(trace.words["section"]):
        samples = np.flatnonzero((trace["section"] == code) & (rolling | ~rolling.any()))
        if len(samples) == 0:
            continue
        fear = np.nan_to_num(trace["decision.fear"][samples], nan=1.0)
        samples = samples[fear >= fear.max() - 1e-6]
        moments.append((name, int(samples[np.argmax(np.abs(trace["curvature_1pm"][samples]))])))
    return [moments[i] for i in np.linspace(0, len(moments) - 1, count).round().astype(int)]


def _map(road: Road, trace: Trace) -> Image:
    """Bird's-eye view: the lane in grey, the driven path in the colour of fear."""
    canvas = np.full((MAP_PX, MAP_PX, 3), PAPER, np.uint8)
    stations_m = np.linspace(0.0, road.length_m, 2000)
    lane = road.positions(stations_m, np.zeros_like(stations_m))
    low = lane.min(axis=0)
    scale = (MAP_PX - 60) / float((lane.max(axis=0) - low).max())

    def pixels(points_m: NDArray[np.float64]) -> Points:
        xy = (points_m - low) * scale + 30
        return np.column_stack([xy[:, 0], MAP_PX - xy[:, 1]]).round().astype(np.int32)

    cv2.polylines(canvas, [pixels(lane)], False, FAINT, 9, cv2.LINE_AA)
    path = pixels(np.column_stack([trace["x_m"], trace["y_m"]]))
    for start in range(0, len(path) - 1, 10):
        fear = float(np.max(trace["decision.fear"][start : start + 10]))
        cv2.polylines(canvas, [path[start : start + 11]], False, fear_colour(fear), 3, cv2.LINE_AA)
    cv2.circle(canvas, tuple(path[0].tolist()), 6, INK, -1, cv2.LINE_AA)
    for section, sample in _moments(trace, count=len(trace.words["section"])):
        x, y = path[sample].tolist()
        _text(canvas, section, (min(x + 8, MAP_PX - 110), y), INK, scale=0.42)
    _text(canvas, f"{road.length_m:.0f} m, path coloured by fear", (12, MAP_PX - 12), INK, scale=0.45)
    return canvas


def _timelines(trace: Trace, width_px: int) -> Image:
    """Fear, speed, lateral error and curvature over time."""
    t_s = trace["t_s"] - trace["t_s"][0]
    rows = [
        ("fear", trace["decision.fear"], (0.0, 1.0)),
        ("speed [m/s]", trace["speed_mps"], (0.0, max(1.0, 1.1 * float(np.nanmax(trace["speed_mps"]))))),
        ("lateral error [m]", trace["lateral_offset_m"], (-0.5, 0.5)),
        ("curvature [1/m]", trace["curvature_1pm"], (-0.08, 0.08)),
    ]
    return np.vstack([_plot(name, t_s, values, limits, width_px) for name, values, limits in rows])


def _plot(name: str, t_s: Column, values: Column, limits: Sequence[float], width_px: int) -> Image:
    canvas = np.full((PLOT_PX, width_px, 3), PAPER, np.uint8)
    left, right, top, bottom = 60, width_px - 20, 22, PLOT_PX - 18
    low, high = limits
    for tick_s in np.arange(0, t_s[-1], 20):
        x = round(left + (right - left) * tick_s / t_s[-1])
        cv2.line(canvas, (x, top), (x, bottom), FAINT, 1)
        _text(canvas, f"{tick_s:.0f} s", (x - 10, PLOT_PX - 4), INK, scale=0.35)
    for level in (low, (low + high) / 2, high):
        y = round(bottom - (bottom - top) * (level - low) / (high - low))
        cv2.line(canvas, (left, y), (right, y), FAINT, 1)
        _text(canvas, f"{level:.2g}", (14, y + 4), INK, scale=0.38)
    seen = np.isfinite(values)
    x_px = left + (right - left) * t_s[seen] / t_s[-1]
    y_px = bottom - (bottom - top) * (np.clip(values[seen], low, high) - low) / (high - low)
    cv2.polylines(
        canvas, [np.column_stack([x_px, y_px]).round().astype(np.int32)], False, (160, 90, 20), 1, cv2.LINE_AA
    )
    _text(canvas, name, (left, 14), INK, scale=0.45)
    return canvas


def _text(
    canvas: Image, text: str, place: tuple[int, int], colour: tuple[int, int, int], *, scale: float
) -> None:
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)
