import numpy as np
import pytest
from test_perception_lane_cv import CAMERA, VEHICLE, road

from perception.techniques.pipeline import Pipeline
from perception.techniques.recipe import recipes
from trepid.config import InputError
from trepid.messages import Frame

RECIPES = recipes()
GOOD = "source: x\n  description: y\n  stages:"


def look(name, image, camera=CAMERA):
    return Pipeline(RECIPES[name], camera, VEHICLE).step(Frame(t_s=0.0, image=image), None, now_s=0.0)


@pytest.mark.parametrize("lane", [(0.0, 0.0, 0.0, 0.0), (0.4, -0.05, 0.0, 0.0), (-0.3, 0.08, 0.0, 0.0)])
def test_the_canonical_chain_measures_a_straight_lane(lane):
    seen = look("canny_hough", road(lane))
    assert seen.estimator == "canny_hough" and seen.lanes_detected == 2 and seen.reason == ""
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.1)
    assert seen.heading_error_rad == pytest.approx(lane[1], abs=0.02)
    assert seen.lane_width_m == pytest.approx(3.4, abs=0.2)
    assert len(seen.left_boundary_px) > 5 and seen.left_boundary_px[0][1] > seen.left_boundary_px[-1][1]


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((240, 320, 3), np.uint8),
        np.full((240, 320, 3), 255, np.uint8),
        np.zeros((1, 1, 3), np.uint8),
        np.zeros((240, 320, 3), np.float32),
        np.zeros((240, 320), np.uint8),
        np.random.default_rng(1).integers(0, 256, (240, 320, 3), np.uint8),
    ],
    ids=["black", "white", "1x1", "float", "grey", "noise"],
)
@pytest.mark.parametrize("name", RECIPES)
def test_no_picture_of_a_road_gives_no_sure_estimate(name, image):
    seen = look(name, image)
    assert seen.road_wheel_angle_rad is None or seen.confidence < 0.3
    assert seen.reason or seen.road_wheel_angle_rad is not None


@pytest.mark.parametrize("name", RECIPES)
def test_the_same_frames_give_the_same_estimates(name):
    image = road((0.2, 0.02, 0.0, 0.0))
    assert look(name, image) == look(name, image)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"a:\n  {GOOD} [cany]", r"4:12: a\.stages\.0: no stage 'cany'; did you mean 'canny'"),
        (f"a:\n  {GOOD} [{{canny: {{lo: 3}}}}]", r"4:21: unknown field 'lo'"),
        (f"a:\n  {GOOD} [{{canny: {{low: -3}}}}]", r"4:21: low: .*greater than 0"),
        (f"a:\n  {GOOD} [hough, canny]", r"4:19: a\.stages\.1: features 'canny' must come before model"),
        (f"a:\n  {GOOD} [canny, hough, hough]", r"4:26: a\.stages\.2: a second model"),
        (f"a:\n  {GOOD} [canny, hough]", r"4:3: a\.stages: no stage of kind state"),
        (f"a:\n  {GOOD} [{{canny: {{}}, grey: {{}}}}]", r"4:12: a\.stages\.0: expected one stage, got 2"),
        ("a: 3", r"1:1: a: expected source"),
        ("a:\n  stages: [canny]", r"'source' is missing"),
        (f"a:\n  surce: x\n  {GOOD} [canny]", r"2:3: unknown field 'surce'; did you mean 'source'"),
    ],
)
def test_a_wrong_pipeline_is_told_with_its_place(text, message, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        recipes(path)
