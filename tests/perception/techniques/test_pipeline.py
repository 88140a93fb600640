import json
from itertools import pairwise

import numpy as np
import pytest
from drawn_road_rig import CAMERA, VEHICLE, road
from technique_rig import VIEW, straight_boundaries

from perception.estimators import ESTIMATORS, FURTHER, build, entry_of, estimators
from perception.techniques.image.picture import (
    Boundaries,
    Evidence,
    FeatureKind,
    Features,
    PixelBox,
    camera_view,
)
from perception.techniques.pipeline import Pipeline, clarity
from perception.techniques.recipe import recipes, settings_of
from perception.techniques.stages import KINDS
from sim_harness.footage.estimate_cli import estimate
from trepid.config import ROOT, InputError
from trepid.messages import EstimateKind, Frame, VehicleState

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


UNMARKED = ("seo_rajkumar", "gabor_vanishing_point")  # and all that begin with road_
LINES = [
    name
    for name, recipe in RECIPES.items()
    if not name.startswith("road_") and name not in UNMARKED and recipe.kind is EstimateKind.LANE
]
RULES = [name for name, recipe in RECIPES.items() if recipe.kind is EstimateKind.ANGLE]


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("lane", [(0.3, -0.04, 0.0, 0.0), (-0.3, 0.04, 0.0, 0.0)], ids=["right", "left"])
def test_every_pipeline_for_lines_measures_a_plain_marked_road(name, lane):
    seen = look(name, road(lane))
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.25)
    assert seen.heading_error_rad == pytest.approx(lane[1], abs=0.03)
    assert seen.confidence > 0.1


@pytest.mark.parametrize("name", RULES)
def test_a_steering_rule_publishes_its_angle_and_no_lane(name):
    seen, other = look(name, road((0.3, 0.04, 0.0, 0.0))), look(name, road((-0.3, -0.04, 0.0, 0.0)))
    assert seen.kind is EstimateKind.ANGLE and entry_of(name).kind is EstimateKind.ANGLE
    assert seen.road_wheel_angle_rad < 0 < other.road_wheel_angle_rad and seen.confidence > 0.1
    lane = (seen.lateral_offset_m, seen.heading_error_rad, seen.curvature_1pm, seen.curvature_rate_1pm2)
    assert lane == (None, None, None, None) and seen.lane_width_m is None
    assert seen.lanes_detected == 2 and seen.left_boundary_px and seen.right_boundary_px


def test_two_steering_rules_on_the_same_boundaries_give_two_estimates():
    image = road((0.3, 0.04, 0.0, 0.0))
    angles = {look(name, image).road_wheel_angle_rad for name in ("rule_tu", "rule_sujatha")}
    assert len(angles) == 2


@pytest.mark.parametrize(
    ("name", "straight"),
    [("rule_tu", False), ("rule_sujatha", True), ("rule_sujatha_middle", True), ("rule_abdelrahman", True)],
)
def test_a_lost_line_is_bridged_for_half_a_second_with_falling_confidence(name, straight):
    pipeline = Pipeline(RECIPES[name], CAMERA, VEHICLE)
    lane, bare = road((0.3, 0.04, 0.0, 0.0)), np.full((CAMERA.height_px, CAMERA.width_px, 3), 105, np.uint8)
    seen, *lost = [
        pipeline.step(Frame(t_s=0.1 * n, image=lane if n == 0 else bare), None, now_s=0.1 * n)
        for n in range(8)
    ]
    held = [estimate for estimate in lost if estimate.road_wheel_angle_rad is not None]
    assert len(held) == 4 and held == lost[:4]  # 0.1 to 0.4 s
    assert {e.road_wheel_angle_rad for e in held} == {0.0 if straight else seen.road_wheel_angle_rad}
    confidences = [estimate.confidence for estimate in (seen, *lost)]
    assert all(after < before for before, after in pairwise(confidences[:5])) and min(confidences[:5]) > 0
    assert all(estimate.lanes_detected == 0 and "line" in estimate.reason for estimate in lost)
    assert all(("straight on" if straight else "held") in estimate.reason for estimate in held)
    assert confidences[5:] == [0.0] * 3


def test_a_jump_in_time_ends_the_bridging_of_a_lost_line():
    pipeline = Pipeline(RECIPES["rule_tu"], CAMERA, VEHICLE)
    bare = np.full((CAMERA.height_px, CAMERA.width_px, 3), 105, np.uint8)
    pipeline.step(Frame(t_s=0.0, image=road((0.3, 0.04, 0.0, 0.0))), None, now_s=0.0)
    assert pipeline.step(Frame(t_s=60.0, image=bare), None, now_s=60.0).road_wheel_angle_rad is None


def test_an_estimator_without_a_steering_rule_measures_the_lane():
    names = ["cv", "cnn", "canny_hough"]
    assert [entry_of(name).kind for name in names] == [EstimateKind.LANE] * 3
    assert look("canny_hough", road((0.0, 0.0, 0.0, 0.0))).kind is EstimateKind.LANE
    with pytest.raises(InputError, match="no estimator 'nothing'"):
        entry_of("nothing")


def test_a_pipeline_for_unmarked_roads_measures_the_road_between_its_edges():
    seen = look("road_colour", road((0.3, -0.03, 0.0, 0.0), 5.5, left=None, right=None, verge_m=0.0))
    assert seen.lateral_offset_m == pytest.approx(0.3, abs=0.15)
    assert seen.heading_error_rad == pytest.approx(-0.03, abs=0.02)
    assert seen.lane_width_m == pytest.approx(5.5, abs=0.3) and seen.confidence > 0.5


def test_the_picture_is_processed_at_one_size_and_reported_at_its_own():
    large = CAMERA.resize(640, 480)
    seen = look("canny_hough", road((0.2, 0.0, 0.0, 0.0), camera=large), large)
    assert seen.lateral_offset_m == pytest.approx(0.2, abs=0.1)
    assert max(y for _, y in seen.left_boundary_px) > 300


def test_a_pipeline_follows_the_motion_of_the_vehicle():
    """The region of the next frame lies about the moved lines."""
    pipeline = Pipeline(RECIPES["speed_roi"], CAMERA, VEHICLE)
    for number in range(6):
        heading = 0.02 * number  # 0.5 rad/s at 25 Hz
        state = VehicleState(
            t_s=0.04 * number,
            speed_mps=8.0,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=0.5,
            driver_override=False,
        )
        frame = Frame(t_s=0.04 * number, image=road((0.0, heading, 0.0, 0.0)))
        seen = pipeline.step(frame, state, now_s=frame.t_s)
        assert seen.heading_error_rad == pytest.approx(heading, abs=0.03)


def test_features_that_fill_the_lane_lower_the_clarity():
    lane = straight_boundaries(far_m=40.0)
    response = np.zeros((240, 320), np.uint8)
    for side in (lane.left, lane.right):
        pixels = VIEW.pixels(np.column_stack([side.x_m, side.y_m])).round().astype(int)
        inside = pixels[(pixels[:, 0] >= 0) & (pixels[:, 0] < 320) & (pixels[:, 1] < 240)]
        response[inside[:, 1], inside[:, 0]] = 255
    assert clarity(Evidence(Features(response, FeatureKind.LINE), VIEW), lane) == 1.0
    noise = (np.random.default_rng(0).random((240, 320)) < 0.3).astype(np.uint8)
    assert clarity(Evidence(Features(noise, FeatureKind.LINE), VIEW), lane) < 0.1
    assert clarity(Evidence(Features(noise, FeatureKind.LINE), VIEW), Boundaries(lane.left, None)) < 0.2
    assert clarity(Evidence(Features(noise, FeatureKind.LINE), VIEW), Boundaries(None, None)) == 1.0


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
def test_an_image_without_a_road_gives_no_confident_estimate(name, image):
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
        (f"a:\n  {GOOD} [canny, hough, exact_pair, pursuit, dev]", r"4:47: .*a rule beside a steer"),
        (f"a:\n  {GOOD} [canny, hough]", r"4:3: a\.stages: no stage of kind state"),
        (f"a:\n  {GOOD} [{{canny: {{}}, grey: {{}}}}]", r"4:12: a\.stages\.0: expected one stage, got 2"),
        ("a: 3", r"1:1: a: expected source"),
        ("a:\n  stages: [canny]", r"'source' is missing"),
        (f"a:\n  surce: x\n  {GOOD} [canny]", r"2:3: unknown field 'surce'; did you mean 'source'"),
    ],
)
def test_an_error_in_a_pipeline_names_its_place(text, message, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        recipes(path)


@pytest.mark.parametrize("kind", KINDS)
def test_every_stage_has_a_docstring_and_typed_settings_with_defaults(kind):
    for name, entry in KINDS[kind].items():
        description = (entry.__doc__ or "") + (getattr(getattr(entry, "step", None), "__doc__", "") or "")
        assert len(description) > 60, name
        assert settings_of(entry)() is not None


def test_every_stage_of_the_front_end_is_in_a_pipeline_or_in_the_table_of_techniques():
    used = {stage.name for recipe in RECIPES.values() for stage in recipe.stages}
    page = (ROOT / "docs" / "techniques.md").read_text()
    for table in KINDS.values():
        for name in table:
            assert name in used or f"`{name}`" in page, name


def test_the_list_prints_description_and_source_of_every_estimator(capsys):
    estimate(estimator="list", as_json=True)
    rows = {row["estimator"]: row for row in map(json.loads, capsys.readouterr().out.splitlines())}
    own = {*ESTIMATORS, *FURTHER, *RECIPES}
    assert set(rows) == {*own, "lead"} and set(estimators()) == own
    assert all(row["description"] and row["source"] for row in rows.values())
    assert rows["canny_hough"]["stages"][0] == "roi_fixed"
    estimate(estimator="list")
    assert "roi_fixed > grey > gaussian > canny > hough" in capsys.readouterr().out


def test_a_pipeline_is_built_by_its_name_like_any_estimator():
    assert isinstance(build("canny_hough"), Pipeline)
    with pytest.raises(InputError, match=r"no estimator 'canny_huff'; did you mean 'canny_hough'"):
        build("canny_huff")


def test_the_default_estimators_do_not_read_the_file_of_the_pipelines(monkeypatch):
    def refuse_file():
        raise InputError("pipelines.yaml:1:1: not valid YAML")

    monkeypatch.setattr("perception.techniques.recipe.recipes", refuse_file)
    assert build("cv") is not None
    with pytest.raises(InputError, match=r"pipelines\.yaml:1:1"):
        build("canny_hough")


def test_a_part_of_a_view_is_kept_for_the_next_frame_and_others_do_not_pile_up() -> None:
    view = camera_view(CAMERA)
    boxes = [PixelBox(top_px, 200, 0, 300) for top_px in range(20)]
    parts = [view.crop(box) for box in boxes]
    assert view.crop(boxes[-1]) is parts[-1]
    again = view.crop(boxes[0])
    assert again is not parts[0] and again.pixel_m == pytest.approx(parts[0].pixel_m, nan_ok=True)
