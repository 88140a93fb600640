"""Models, trackers and states as whole pipelines, on drawn roads that bend (inventory B17–B32, T01–T05)."""

from pathlib import Path

import numpy as np
import pytest
from drawn_road_rig import CAMERA, VEHICLE, road

from perception.techniques.pipeline import Pipeline
from perception.techniques.recipe import PipelineRecipe, recipes
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


ARCS = """
  source: derived
  description: two concentric arcs
  {inside}
  stages: [roi_fixed, grey, dark_bright_dark, {{arcs: {{{arcs}}}}}, arc_lane, pursuit]
"""


def arcs_of(folder: Path, *, inside: str = "", arcs: str = "") -> PipelineRecipe:
    """`arcs` with these lines in its file."""
    file = folder / "pipelines.yaml"
    file.write_text("arcs:" + ARCS.format(inside=inside, arcs=arcs))
    return recipes(file)["arcs"]


def test_what_a_pipeline_leaves_out_are_for_the_default_car_the_numbers_for_roads(tmp_path: Path):
    usual = Pipeline(arcs_of(tmp_path), CAMERA, VEHICLE)
    given = Pipeline(
        arcs_of(tmp_path, inside="inside_m: 8.0", arcs="reach_m: 25.0, bend_1pm: 0.02"), CAMERA, VEHICLE
    )
    other = Pipeline(arcs_of(tmp_path, arcs="reach_m: 12.0, bend_1pm: 0.1"), CAMERA, VEHICLE)
    differ = 0
    for number in range(12):
        image = road((0.2, 0.01 * number - 0.05, 1 / 60, 0.0))
        frame = Frame(t_s=0.04 * number, image=image)
        seen = [one.step(frame, state(frame.t_s), now_s=frame.t_s) for one in (usual, given, other)]
        assert seen[0] == seen[1] and seen[0].confidence > 0.0
        differ += seen[2] != seen[0]
    assert differ > 6


def test_a_camera_half_as_high_looks_half_as_far_for_bends_four_times_as_tight(tmp_path: Path):
    low = CAMERA.model_copy(update={"height_m": CAMERA.height_m / 2})
    usual = Pipeline(arcs_of(tmp_path), low, VEHICLE)
    given = Pipeline(
        arcs_of(tmp_path, inside="inside_m: 4.0", arcs="reach_m: 12.5, bend_1pm: 0.08"), low, VEHICLE
    )
    for number in range(6):
        frame = Frame(t_s=0.04 * number, image=road((0.1, 0.02, 1 / 20, 0.0), camera=low))
        seen = [one.step(frame, state(frame.t_s), now_s=frame.t_s) for one in (usual, given)]
        assert seen[0] == seen[1] and seen[0].confidence > 0.0
