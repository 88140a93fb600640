import numpy as np
import pytest

from perception.lane.agreement import (
    agreement,
    apart,
    lane_columns,
    marginal,
    overlap,
    shift_image,
    with_noise,
)
from perception.net.confirmed import agreement_degree
from trepid.messages import SteeringEstimate


def lane(left_px, right_px):
    rows = np.full(32, 1.0)
    return np.stack([left_px * rows, right_px * rows])


def test_overlap_is_the_shared_share_of_both_areas():
    assert overlap(lane(0, 100), lane(0, 100)) == 1.0
    assert overlap(lane(0, 100), lane(50, 150)) == pytest.approx(1 / 3)
    assert overlap(lane(0, 100), lane(200, 300)) == 0.0


def test_no_lane_overlaps_with_nothing_not_even_with_another_missing_lane():
    assert overlap(lane(0, 0), lane(0, 100)) == 0.0
    assert overlap(lane(0, 0), lane(0, 0)) == 0.0


def test_lanes_with_ragged_edges_are_the_same_and_a_lane_beside_is_another_one():
    assert agreement(lane(0, 100), lane(5, 98)) == 1.0
    assert agreement(lane(0, 100), lane(50, 150)) == 0.0
    assert 0 < agreement(lane(0, 100), lane(20, 110)) < 1


def test_a_probability_that_all_lanes_share_stays():
    lanes = [lane(10, 90)] * 3
    assert marginal(np.full(3, 0.8), np.array([1.0, 2.0, 0.1]), lanes) == pytest.approx([0.8] * 3)


def test_a_lane_that_the_others_contradict_loses_their_weight():
    lanes = [lane(10, 90), lane(10, 90), lane(200, 300)]
    found = marginal(np.full(3, 0.9), np.ones(3), lanes)
    assert found == pytest.approx([0.6, 0.6, 0.3])


def test_a_height_without_a_lane_lowers_the_probability_by_its_weight():
    found = marginal(np.array([0.9, 0.0]), np.array([1.0, 0.1]), [lane(10, 90), lane(0, 0)])
    assert found == pytest.approx([0.9 * 1.0 / 1.1, 0.0])


def between(left_px, right_px):
    """A lane in an image of 100 rows, with its boundaries through these columns at the rows 50 and 100."""
    return SteeringEstimate(
        t_s=0.0,
        estimator="cv",
        lookahead_m=8.0,
        confidence=1.0,
        reason="",
        left_boundary_px=tuple(zip(left_px, (50.0, 100.0), strict=True)) if left_px else (),
        right_boundary_px=tuple(zip(right_px, (50.0, 100.0), strict=True)) if right_px else (),
    )


LANE = between((80.0, 40.0), (120.0, 160.0))


def test_lanes_are_apart_by_the_greater_distance_of_their_sides_in_widths_of_the_other():
    assert apart(LANE, LANE, 100) == 0.0
    wide = between((100.0, 100.0), (200.0, 200.0))
    assert apart(between((110.0, 110.0), (170.0, 170.0)), wide, 100) == pytest.approx(0.3)
    assert apart(between((), ()), wide, 100) is None and apart(wide, between((), ()), 100) is None


def test_a_lane_is_confirmed_by_no_witness_whose_left_boundary_is_right_of_the_right_one():
    crossed = between((120.0, 160.0), (80.0, 40.0))
    assert apart(LANE, crossed, 100) == apart(crossed, crossed, 100) == np.inf
    assert agreement_degree(apart(LANE, crossed, 100)) == 0.0
    far_ones_cross = between((102.0, 40.0), (98.0, 160.0))
    assert 0.0 < apart(LANE, far_ones_cross, 100) < 0.3
    no_width = between((80.0, 40.0), (80.0, 40.0))
    assert apart(no_width, no_width, 100) == np.inf


def test_columns_are_those_of_the_boundaries_inside_the_image():
    estimate = SteeringEstimate(
        t_s=0.0,
        estimator="cv",
        lookahead_m=8.0,
        confidence=1.0,
        reason="",
        left_boundary_px=((-50.0, 100.0), (50.0, 50.0)),
        right_boundary_px=((150.0, 100.0), (100.0, 50.0)),
    )
    found = lane_columns(estimate, 100, 200)
    assert found[:, 0] == pytest.approx([50.0, 100.0])
    assert found[0, -1] == 0.0 and found[1, -1] == pytest.approx(149.0)


@pytest.mark.parametrize("shape", [(40, 60, 3), (40, 60)])
def test_the_changed_images_differ_by_two_grey_levels_and_by_one_pixel(shape):
    image = np.random.default_rng(2).integers(0, 256, shape, np.uint8)
    noisy, moved = with_noise(image), shift_image(image)
    assert noisy.shape == moved.shape == image.shape
    difference = np.abs(noisy.astype(int) - image)
    assert difference.max() == 2 and difference.mean() > 0.5
    assert (moved[1:, 1:] == image[:-1, :-1]).all()
