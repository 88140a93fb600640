"""Techniques are ranked by right lanes on each data set; smaller images show the same road."""

import numpy as np
import pytest

from lab.bench.perception.clips import WARM_UP_FRAMES, ClipCase, harness_set
from lab.bench.perception.watch import LOOK, TRUTH, WatchedClip
from lab.bench.study.areas import (
    GREY,
    SIZES,
    clips_of,
    compared_techniques,
    forms_of,
    grey,
    percent,
    rank_techniques,
    right_percent,
    scene_of,
    smaller_image,
)
from perception.estimators import estimators
from sim_harness.world.roads.drawn import BendShape, MarkingKind
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import EstimateKind

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
MARKED = ClipCase(1, 0, "clear", 0, MarkingKind.WHITE, BendShape.STRAIGHT)
UNMARKED = ClipCase(1, 0, "clear", 0, MarkingKind.GRAVEL, BendShape.STRAIGHT)
RAIN = ClipCase(1, 0, "rain", 3, MarkingKind.WHITE, BendShape.STRAIGHT)


def watched_clip(**right: int) -> WatchedClip:
    """A clip on which each technique has this number of right frames of ten; in the others it gives none."""
    looks = {}
    for name, count in right.items():
        looks[name] = np.zeros(WARM_UP_FRAMES + 10, LOOK)
        for field in ("offset_m", "aim_m", "angle_rad"):
            looks[name][field] = np.nan
            looks[name][field][WARM_UP_FRAMES : WARM_UP_FRAMES + count] = 0.0
        looks[name]["time_s"] = looks[name]["bare_chain_s"] = 1e-3
    return WatchedClip(np.zeros(WARM_UP_FRAMES + 10, TRUTH), looks)


def test_every_technique_that_gives_a_lane_is_compared_and_none_that_gives_an_angle_alone():
    names, known = compared_techniques(), estimators()
    assert len(names) > 30 and len(set(names)) == len(names)
    assert {known[name].kind for name in names} == {EstimateKind.LANE}


def test_a_data_set_has_every_kind_of_road_and_every_disturbance_of_its_seed():
    cases = clips_of(3)
    assert {case.kind for case in cases if case.condition == "clear"} == set(MarkingKind)
    whole = {case.condition for case in harness_set(3)} - {"gap"}
    assert {case.condition for case in cases} == whole and {case.seed for case in cases} == {3}


def test_the_best_on_every_data_set_has_rank_one_and_equals_share_the_middle():
    clips = (MARKED, UNMARKED, RAIN)
    found = [{clip: watched_clip(a=9, b=5, c=5) for clip in clips} for _ in range(3)]
    table = rank_techniques(found, ("b", "a", "c"))
    assert next(iter(table)) == "a"
    assert [table[name]["mean rank"] for name in "abc"] == [1.0, 2.5, 2.5]
    row = table["a"]
    assert row["from"] == row["to"] == 1.0 and row["right [%]"] == row["right from"] == 90.0


def test_shares_are_of_all_frames_and_of_the_clips_of_a_part():
    found = {MARKED: watched_clip(a=10), UNMARKED: watched_clip(a=0), RAIN: watched_clip(a=5)}
    shares = [right_percent(found, "a", part) for part in ("all", "marked", "unmarked", "disturbed")]
    assert shares == [50.0, 100.0, 0.0, 50.0]


@pytest.mark.parametrize(
    ("case", "scene"), [(MARKED, "clear, marked"), (UNMARKED, "clear, unmarked"), (RAIN, "rain")]
)
def test_a_scene_is_the_disturbance_or_the_kind_of_road(case, scene):
    assert scene_of(case) == scene


def test_counts_add_up_to_a_share():
    assert percent([(1, 2), (2, 2)]) == 75.0 and percent([(0, 7)]) == 0.0


def test_a_smaller_image_shows_the_same_road_and_grey_keeps_its_light():
    forms = dict(forms_of([], CAMERA))
    assert list(forms)[-1] == GREY and len(forms) == len(SIZES) + 1
    road_m = np.array([[8.0, 1.5], [20.0, -2.0]])
    for (width_px, height_px), (camera, _) in zip(SIZES, forms.values(), strict=False):
        shares = (camera.pixel_from_road(road_m) + 0.5) / (width_px, height_px)
        whole = (CAMERA.pixel_from_road(road_m) + 0.5) / (CAMERA.width_px, CAMERA.height_px)
        assert shares == pytest.approx(whole)
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    small = smaller_image(image, (80, 60))
    assert small.mean() == pytest.approx(image.mean(), abs=0.5), "areas keep the mean"
    plain = grey(image)
    assert (plain[..., 0] == plain[..., 1]).all() and (plain[..., 0] == plain[..., 2]).all()
