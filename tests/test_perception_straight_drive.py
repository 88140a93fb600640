"""Pitch, yaw and height of a camera are found again from drawn drives along a straight road."""

import math
from functools import cache

import numpy as np
import pytest

from perception.camera_height import Step
from perception.straight_drive import mounting
from sim_harness.render.renderer import Renderer
from sim_harness.roads.drawn import Kind, random_section
from sim_harness.roads.road import Road, RoadSettings, Segment
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

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


def test_pitch_yaw_and_height_are_found_from_the_speed() -> None:
    found = mounting(clip(Kind.WHITE), KNOWN)
    assert found.height_from == "the speed"
    assert found.pitch_down_rad == pytest.approx(TRUE.pitch_down_rad, abs=math.radians(0.25))
    assert found.yaw_rad == pytest.approx(TRUE.yaw_rad, abs=math.radians(0.4))
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_the_width_of_the_lane_tells_the_height_as_well() -> None:
    found = mounting([Step(step.image) for step in clip(Kind.YELLOW)], KNOWN, lane_width_m=LANE_M)
    assert found.height_from == "the width of the lane"
    assert found.height_m == pytest.approx(TRUE.height_m, rel=0.03)


def test_without_a_known_length_the_height_stays() -> None:
    found = mounting([Step(step.image) for step in clip(Kind.WHITE)], KNOWN)
    assert (found.height_m, found.height_from) == (KNOWN.height_m, "the camera file")


def test_lens_distortion_is_taken_out_first() -> None:
    bent = KNOWN.model_copy(update={"distortion": (-0.2, 0.05, 0.0, 0.0, 0.0)})
    straight = [Step(step.image) for step in clip(Kind.WHITE)]
    plain, undistorted = mounting(straight, KNOWN), mounting(straight, bent)
    assert abs(plain.pitch_down_rad - undistorted.pitch_down_rad) > math.radians(0.3)


def test_a_bend_is_refused() -> None:
    with pytest.raises(InputError, match="this is no straight road: it turns by"):
        mounting(clip(Kind.WHITE, curvature_1pm=0.01, sway_m=0.0), KNOWN)


def test_swerving_is_refused() -> None:
    with pytest.raises(InputError, match="this is no straight driving: the heading sways by"):
        mounting(clip(Kind.WHITE, sway_m=0.3), KNOWN)


def test_gravel_without_lines_is_refused() -> None:
    with pytest.raises(InputError, match="of the lines in sight meet in one place"):
        mounting(clip(Kind.GRAVEL), KNOWN)


@pytest.mark.parametrize("grey", [0, 128])
def test_pictures_without_a_road_are_refused(grey: int) -> None:
    with pytest.raises(InputError, match="lines along the road in 0 of 8 frames, 5 expected"):
        mounting([Step(np.full((240, 320, 3), grey, np.uint8))] * 8, KNOWN)
