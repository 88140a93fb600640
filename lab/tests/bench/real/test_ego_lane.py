import numpy as np
import pytest

from lab.bench.real.ego_lane import figures, fixed_lane, lanes_of_files, overlap
from lab.bench.real.judgement import JudgedLane

LANE = np.array([[0.2, 0.3, 0.4], [0.8, 0.7, 0.6]])
GONE = np.full_like(LANE, np.nan)
JUDGED = {
    "a.png": [JudgedLane("right", LANE + 0.3), JudgedLane("lane", LANE)],
    "b.png": [JudgedLane("lane", LANE + 0.02)],
}


def rows(*lanes):
    return [{"file": file, "estimates": {"cv": {"lane": lane.tolist()}}} for file, lane in lanes]


def test_the_lane_itself_overlaps_fully_half_of_it_half_and_none_not_at_all():
    half = np.array([LANE[0], LANE.mean(axis=0)])
    assert overlap(LANE, LANE) == 1.0
    assert overlap(half, LANE) == pytest.approx(0.5)
    assert overlap(GONE, LANE) == 0.0
    assert overlap(LANE + 1.0, LANE) == 0.0


def test_only_the_part_inside_the_image_counts():
    beyond = LANE - [[0.9], [0.0]]
    assert overlap(beyond, np.array([np.zeros(3), LANE[1]])) == 1.0


def test_only_lanes_drawn_by_eye_are_the_truth():
    assert list(lanes_of_files(["a.png", "c.png"], JUDGED)) == ["a.png"]
    assert lanes_of_files(["a.png"], JUDGED)["a.png"] == pytest.approx(LANE)


def test_the_lane_of_other_sequences_is_their_median():
    assert fixed_lane(["a.png", "b.png"], JUDGED) == pytest.approx(LANE + 0.01)
    assert fixed_lane(["c.png"], JUDGED) is None


def test_an_answer_without_a_lane_counts_as_no_overlap():
    found = figures(rows(("a.png", LANE), ("b.png", GONE)), "cv", JUDGED, LANE)
    assert found["drawn_lanes"] == 2
    assert found["ego_iou"] == pytest.approx(0.5)
    assert 0.9 < found["baseline_ego_iou"] < 1.0


def test_without_drawn_lanes_there_is_no_figure():
    found = figures(rows(("c.png", LANE)), "cv", JUDGED, LANE)
    assert set(found.values()) == {None}
