from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.estimators import lane_cv_settings
from perception.lane.street.pairs import BoundaryKind, boundaries, chosen_share, kerb_side, pairs
from perception.lane.street.profile import Profile, StreetCourse

SETTINGS = lane_cv_settings().street.pairs
LEFT_M = np.arange(7.0, -7.05, -0.1)


def street(lines=(), kerbs=(), road_m=(7.0, -7.0)):
    """A profile with lines (place, share of rows), kerbs, and road between two places."""
    line, step = np.zeros(len(LEFT_M)), np.zeros(len(LEFT_M))
    for place_m, share in lines:
        line[np.abs(LEFT_M - place_m).argmin()] = share
    for place_m in kerbs:
        step[np.abs(LEFT_M - place_m).argmin()] = 0.6
    other = ((road_m[0] < LEFT_M) | (road_m[1] > LEFT_M)).astype(float)
    seen = np.ones(len(LEFT_M), bool)
    return Profile(StreetCourse(0.0, 0.0, 0.4), LEFT_M, seen, line, np.zeros(len(LEFT_M)), step, other)


def rank_pairs(profile, **kwargs):
    return pairs(profile, boundaries(profile, SETTINGS), SETTINGS, height_sigma=0.2, **kwargs)


@pytest.mark.parametrize("side", [1, -1])
def test_of_a_two_way_street_the_half_between_kerb_and_dashed_line_is_the_lane(side):
    profile = street([(-1.6 * side, 0.3)], [1.6 * side, -4.8 * side], sorted((1.6 * side, -4.8 * side))[::-1])
    best = rank_pairs(profile)[0]
    assert [best.left.left_m, best.right.left_m] == pytest.approx([1.6, -1.6], abs=0.06)
    assert best.probability > 0.5 and kerb_side(best, profile, SETTINGS) == side


def test_a_lane_with_a_line_inside_is_less_probable_than_a_plain_one():
    (plain,) = rank_pairs(street([(1.7, 0.8), (-2.0, 0.8)]))
    divided = rank_pairs(street([(1.7, 0.8), (-0.1, 0.3), (-2.0, 0.8)]))
    whole = next(one for one in divided if one.width_m > 3.5)
    assert whole.probability < plain.probability - 0.3


def test_a_step_beside_a_line_is_no_boundary_of_its_own():
    found = boundaries(street([(1.6, 0.8)], [1.8, 3.0]), SETTINGS)
    assert [one.kind for one in found] == [BoundaryKind.STEP, BoundaryKind.LINE]


def test_the_kerb_of_the_wrong_side_is_less_probable_where_the_side_of_the_traffic_is_known():
    profile = street([(-1.6, 0.3)], [1.6])
    right, left = rank_pairs(profile, on_left=0.0)[0], rank_pairs(profile, on_left=1.0)[0]
    assert right.probability < left.probability


def test_a_pair_that_was_the_lane_in_the_frame_before_is_more_probable():
    profile = street([(1.7, 0.3), (-1.5, 0.3), (-2.3, 0.3)])
    alone = rank_pairs(profile)
    second = alone[1]
    kept = replace(second, probability=0.9)
    assert rank_pairs(profile, before=(kept,))[0].right == second.right


def test_a_street_without_boundaries_has_no_pairs():
    assert rank_pairs(street()) == []


def test_the_height_that_makes_a_pair_as_wide_as_a_lane_is_the_more_likely_one():
    (narrow,) = rank_pairs(street([(1.2, 0.8), (-1.2, 0.8)]))
    (wide,) = rank_pairs(street([(2.1, 0.8), (-2.1, 0.8)]))
    assert narrow.height > 1.05 and wide.height < 0.95


@pytest.mark.parametrize("on_left", [0.0, 1.0])
def test_of_a_road_for_both_ways_without_a_line_the_half_on_the_side_of_the_traffic_is_the_lane(on_left):
    car_m = 1.5 if on_left else -1.5  # the middle of the road lies to the right of a car on the left
    best = rank_pairs(street(kerbs=(3.1 - car_m, -3.1 - car_m)), on_left=on_left)[0]
    kinds = [BoundaryKind.STEP, BoundaryKind.MIDDLE]
    assert [best.left.kind, best.right.kind] == (kinds if on_left else kinds[::-1])
    assert best.width_m == pytest.approx(3.1, abs=0.06) and best.offset_m == pytest.approx(0.0, abs=0.1)


def test_in_the_middle_of_a_road_for_both_ways_neither_half_is_probable_while_the_traffic_is_unknown():
    found = rank_pairs(street(kerbs=(3.1, -3.1)))
    assert max(one.probability for one in found) < 0.5


def test_a_road_as_wide_as_one_lane_is_not_halved():
    best = rank_pairs(street(kerbs=(1.9, -1.9)))[0]
    assert BoundaryKind.MIDDLE not in (best.left.kind, best.right.kind)


@pytest.mark.parametrize("on_left", [0.0, 1.0])
def test_lines_at_the_ends_of_a_road_for_both_ways_enclose_its_halves_as_kerbs_do(on_left):
    car_m = 1.5 if on_left else -1.5
    ends = (3.1 - car_m, -3.1 - car_m)
    best = rank_pairs(street([(end, 0.8) for end in ends], road_m=ends), on_left=on_left)[0]
    kinds = [BoundaryKind.LINE, BoundaryKind.MIDDLE]
    assert [best.left.kind, best.right.kind] == (kinds if on_left else kinds[::-1])
    assert best.width_m == pytest.approx(3.1, abs=0.06) and best.probability > 0.5


def test_lines_with_road_beyond_enclose_no_halves():
    found = rank_pairs(street([(3.1, 0.8), (-3.1, 0.8)]))
    assert [(one.left.kind, one.right.kind) for one in found] == [(BoundaryKind.LINE, BoundaryKind.LINE)]
    assert found[0].one_lane == 1.0


@given(width_m=st.floats(2.8, 6.5), offset_m=st.floats(-1.2, 1.2), kerbs=st.booleans())
def test_whether_a_road_is_one_lane_follows_from_its_width_wherever_the_car_stands(width_m, offset_m, kerbs):
    def one_lane(between_m, aside_m):
        ends = (between_m / 2 - aside_m, -between_m / 2 - aside_m)
        profile = street(kerbs=ends) if kerbs else street([(end, 0.8) for end in ends], road_m=ends)
        kind = BoundaryKind.STEP if kerbs else BoundaryKind.LINE
        (whole,) = (one for one in rank_pairs(profile) if {one.left.kind, one.right.kind} == {kind})
        return whole.one_lane

    assert one_lane(width_m, offset_m) == pytest.approx(one_lane(width_m, 0.0), abs=0.12)  # places of 0.1 m
    assert one_lane(width_m + 0.5, 0.0) < one_lane(width_m, 0.0)
    assert one_lane(6.0, offset_m) < 0.3 and one_lane(3.2, offset_m) > 0.85


def test_the_half_of_a_road_says_nothing_of_the_side_of_the_traffic():
    profile = street(kerbs=(4.6, -1.6))
    half = next(one for one in rank_pairs(profile) if BoundaryKind.MIDDLE in (one.left.kind, one.right.kind))
    assert kerb_side(half, profile, SETTINGS) == 0


def test_equal_neighbours_are_one_boundary_at_their_middle():
    profile = street()
    profile.line[(LEFT_M < 1.86) & (LEFT_M > 1.34)] = 0.8
    (found,) = boundaries(profile, SETTINGS)
    assert found.left_m == pytest.approx(1.6, abs=0.11)


def test_of_two_equal_pairs_the_chosen_one_has_half_and_pairs_at_the_same_place_count_together():
    best = rank_pairs(street([(1.7, 0.8), (-1.7, 0.8)]))[0]
    beside = replace(best, left=replace(best.left, left_m=best.left.left_m + 3.0))
    assert chosen_share([best], SETTINGS) == pytest.approx(1.0)
    assert chosen_share([best, beside], SETTINGS) == pytest.approx(0.5)
    assert chosen_share([best, best, beside], SETTINGS) == pytest.approx(2 / 3)
    assert chosen_share([replace(best, probability=0.0)], SETTINGS) == 0.0
