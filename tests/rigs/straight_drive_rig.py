"""Rendered pairs of frames of a straight drive with a known camera."""

import math
from functools import cache

import numpy as np

from perception.camera.height import Step
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.drawn import Kind, random_section
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load

KNOWN = load(CONFIG_DIR / "camera.yaml", Camera)


TRUE = KNOWN.model_copy(update={"pitch_down_rad": 0.09, "yaw_rad": -0.04, "height_m": 1.7})


LANE_M, SPEED_MPS, PERIOD_S = 3.3, 8.0, 0.04


WAVE_M = 40.0  # the driver wanders once to and fro over the clip


@cache
def clip(kind: Kind, curvature_1pm: float = 0.0, sway_m: float = 0.12, frames: int = 10) -> tuple[Step, ...]:
    road = Road(
        RoadSettings(
            name="straight",
            closed=False,
            lane_width_m=LANE_M,
            segments=(Segment(length_m=200, curvature_1pm=curvature_1pm),),
            sections=(random_section(kind, np.random.default_rng(3)),),
        )
    )
    renderer = Renderer(road, TRUE, seed=1)

    def frame(station_m: float) -> np.ndarray:
        rate = 2 * math.pi / WAVE_M
        x_m, y_m = road.position(station_m, sway_m * math.sin(rate * station_m))
        yaw_rad = road.heading_at(station_m) + math.atan(sway_m * rate * math.cos(rate * station_m))
        return renderer.render(x_m, y_m, yaw_rad, t_s=station_m / SPEED_MPS, station_m=station_m)

    way_m = SPEED_MPS * PERIOD_S
    places = (10.0 + WAVE_M * np.arange(frames) / frames).tolist()
    return tuple(Step(frame(place), frame(place + way_m), way_m) for place in places)
