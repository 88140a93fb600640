"""Conversions between the lane between lines and the road between its edges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.estimators import lane_cv_settings
from perception.lane.model.geometry import KAPPA, KAPPA_RATE, PSI, WIDTH, E, LaneState
from perception.lane.model.lane_in_road import (
    along_road,
    half_with_vehicle,
    lane_within,
    one_lane_probability,
    road_around,
    with_max_sigma,
    with_neighbour,
)

PRIOR, EVIDENCE = lane_cv_settings().prior, lane_cv_settings().evidence


def state(offset_m: float, width_m: float) -> LaneState:
    return LaneState(mean=np.array([offset_m, 0.02, 0.01, 0.0, width_m, 0.0]), covariance=0.01 * np.eye(6))


def edges_m(lane: LaneState) -> tuple[float, float]:
    """Right and left boundary relative to the vehicle."""
    e, width = lane.mean[[E, WIDTH]]
    return -e - width / 2, -e + width / 2


def test_the_road_around_a_lane_has_a_shoulder_on_each_side():
    right, left = edges_m(state(0.3, 3.4))
    assert edges_m(road_around(state(0.3, 3.4), PRIOR)) == pytest.approx(
        (right - PRIOR.shoulder_m, left + PRIOR.shoulder_m)
    )


@pytest.mark.parametrize("side", [1, -1])
def test_a_neighbouring_lane_moves_the_edge_on_its_side_by_the_width_of_a_lane(side):
    lane = state(0.3, 3.4)
    right, left = edges_m(lane)
    assert edges_m(with_neighbour(lane, lane, side)) == pytest.approx(
        (right - 3.4 * (side < 0), left + 3.4 * (side > 0))
    )
    assert edges_m(with_neighbour(lane, lane, 0)) == (right, left)


@pytest.mark.parametrize("offset_m", [1.7, -1.7, 0.1, 0.0])
def test_the_lane_within_a_wide_road_contains_the_vehicle(offset_m):
    lane = lane_within(state(offset_m, 7.0), PRIOR)
    assert lane.mean[WIDTH] == PRIOR.width_m
    assert abs(lane.mean[E]) < PRIOR.width_m / 2


@pytest.mark.parametrize("side", [1, -1])
def test_the_half_with_the_vehicle_ends_at_the_middle_of_the_road(side):
    half = half_with_vehicle(state(side * 1.7, 7.0), PRIOR)
    assert half is not None and half.mean[E] == pytest.approx(side * (1.7 - 7.0 / 4))
    assert half.mean[WIDTH] == pytest.approx(3.5 - PRIOR.shoulder_m)


def test_a_vehicle_in_the_middle_of_the_road_is_in_neither_half():
    assert half_with_vehicle(state(0.1, 7.0), PRIOR) is None


def test_a_lane_along_a_road_keeps_place_and_width_and_has_the_course_of_the_road():
    lane = LaneState(mean=np.array([0.2, 0.0, 0.0, 0.0, 3.5, 0.0]), covariance=0.01 * np.eye(6))
    road = LaneState(mean=np.array([-0.5, 0.03, 0.02, 0.001, 5.0, 0.0]), covariance=0.04 * np.eye(6))
    both = along_road(lane, road)
    assert both.mean[[E, WIDTH]].tolist() == [0.2, 3.5]
    assert both.mean[[PSI, KAPPA, KAPPA_RATE]].tolist() == [0.03, 0.02, 0.001]
    assert np.linalg.eigvalsh(both.covariance).min() > 0


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.floats(0.05, 5.0))
def test_a_limited_deviation_keeps_the_covariance_positive_definite(seed, index, sigma):
    root = np.random.default_rng(seed).normal(size=(6, 6))
    covariance = root @ root.T + 1e-3 * np.eye(6)
    limited = with_max_sigma(covariance, index, sigma)
    assert np.linalg.eigvalsh(limited).min() > 0
    assert limited[index, index] == pytest.approx(min(covariance[index, index], sigma**2))
    others = np.delete(np.arange(6), index)
    assert (limited[np.ix_(others, others)] == covariance[np.ix_(others, others)]).all()


@pytest.mark.parametrize(
    ("width_m", "offset_m", "low", "high"),
    [
        (3.8, 0.0, 0.8, 1.0),
        (7.0, 0.9, 0.0, 0.2),
        (4.4, 0.0, 0.7, 1.0),
        (4.4, 1.1, 0.3, 0.75),
        (7.0, 1.7, 0.0, 0.01),
    ],
)
def test_a_wide_road_or_a_vehicle_beside_its_middle_means_two_lanes(width_m, offset_m, low, high):
    found = one_lane_probability(width_m, offset_m, PRIOR, EVIDENCE)
    assert low <= found <= high
    assert found == pytest.approx(one_lane_probability(width_m, -offset_m, PRIOR, EVIDENCE))


@pytest.mark.parametrize("width_m", [3.5, 5.0, 6.5])
def test_by_the_width_alone_one_lane_is_less_probable_than_from_its_middle(width_m):
    by_width = one_lane_probability(width_m, None, PRIOR, EVIDENCE)
    quarter = one_lane_probability(width_m, width_m / 4, PRIOR, EVIDENCE)
    assert quarter < by_width < one_lane_probability(width_m, 0.0, PRIOR, EVIDENCE)


def test_a_road_of_an_impossible_width_is_no_lane():
    assert one_lane_probability(80.0, 0.0, PRIOR, EVIDENCE) == 0.0
