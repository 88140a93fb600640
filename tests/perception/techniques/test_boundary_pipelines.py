"""Models, trackers and states as whole pipelines, on drawn roads that bend (inventory B17–B32, T01–T05)."""

import numpy as np
import pytest
from drawn_road_rig import CAMERA, VEHICLE, road

from perception.techniques.pipeline import Pipeline
from perception.techniques.recipe import recipes
from trepid.messages import Frame, VehicleState

RECIPES = recipes()
BENDING = [
    "ransac_parabola",
    "ransac_bspline",
    "straight_curve",
    "histogram_cubic",
    "hyperbola",
    "pchip",
    "interrupted_ekf",
    "particles",
]
TRACKED = ["ransac_parabola", "interrupted_ekf", "particles"]
BLACK = np.zeros((240, 320, 3), np.uint8)


def state(t_s: float) -> VehicleState:
    return VehicleState(
        t_s=t_s, speed_mps=8.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )


@pytest.mark.parametrize("name", BENDING)
@pytest.mark.parametrize("lane", [(0.2, 0.0, 1 / 50, 0.0), (-0.2, 0.0, -1 / 80, 0.0)], ids=["left", "right"])
def test_a_pipeline_for_bends_measures_offset_heading_and_curvature(name, lane):
    pipeline, image = Pipeline(RECIPES[name], CAMERA, VEHICLE), road(lane)
    for number in range(3):
        seen = pipeline.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.1)
    assert seen.heading_error_rad == pytest.approx(lane[1], abs=0.025)
    assert seen.curvature_1pm == pytest.approx(lane[2], abs=0.003)
    assert seen.lane_width_m == pytest.approx(3.4, rel=0.03)
    assert seen.confidence > 0.3


@pytest.mark.parametrize("name", TRACKED)
def test_a_tracked_pipeline_bridges_dark_frames_with_falling_confidence_up_to_a_limit(name):
    pipeline, image = Pipeline(RECIPES[name], CAMERA, VEHICLE), road((0.2, 0.0, 0.0, 0.0))
    for number in range(5):
        clear = pipeline.step(Frame(t_s=0.04 * number, image=image), state(0.04 * number), now_s=0.0)
    seen = []
    for number in range(5, 130):
        frame = Frame(t_s=0.04 * number, image=BLACK)
        seen.append(pipeline.step(frame, state(frame.t_s), now_s=0.0))
    assert seen[10].lateral_offset_m == pytest.approx(clear.lateral_offset_m, abs=0.2)
    assert 0 < seen[40].confidence < seen[10].confidence < clear.confidence
    assert seen[10].reason and seen[-1].lateral_offset_m is None and seen[-1].reason


@pytest.mark.parametrize("name", TRACKED)
def test_a_jump_in_time_ends_the_memory_of_a_tracker(name):
    pipeline, image = Pipeline(RECIPES[name], CAMERA, VEHICLE), road((0.2, 0.0, 0.0, 0.0))
    for number in range(5):
        pipeline.step(Frame(t_s=0.04 * number, image=image), state(0.04 * number), now_s=0.0)
    for t_s in (30.0, 1.0):  # on, and back
        seen = pipeline.step(Frame(t_s=t_s, image=BLACK), state(t_s), now_s=0.0)
        assert seen.lateral_offset_m is None and seen.reason
