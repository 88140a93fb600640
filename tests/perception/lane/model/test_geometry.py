"""Distances of road points from lanes, and the deviation of the lane centre ahead from the covariance."""

import numpy as np
import pytest

from perception.lane.model.geometry import KAPPA, PSI, E, LaneState, distances, lane_coordinates
from trepid.messages import SIGMA_AHEAD_M


def test_the_deviation_ahead_is_that_of_lanes_drawn_from_the_covariance() -> None:
    rng = np.random.default_rng(4)
    spread = np.diag([0.1, 0.01, 1e-3, 1e-5, 0.1, 0.01])
    root = spread @ (np.eye(6) + 0.4 * rng.standard_normal((6, 6)))
    state = LaneState(mean=np.zeros(6), covariance=root @ root.T)
    drawn = (root @ rng.standard_normal((6, 4000))).T
    y_m = [[LaneState(row, state.covariance).clothoid.y_m(x) for x in SIGMA_AHEAD_M] for row in drawn]
    assert state.ahead_sigma_m == pytest.approx(np.std(y_m, axis=0), rel=0.05)


@pytest.mark.parametrize(("component", "power"), [(E, 0), (PSI, 1), (KAPPA, 2)])
def test_offset_heading_and_curvature_alone_grow_with_their_power_of_the_distance(
    component: int, power: int
) -> None:
    covariance = np.zeros((6, 6))
    covariance[component, component] = 0.01**2
    sigma_m = LaneState(np.zeros(6), covariance).ahead_sigma_m
    assert sigma_m[4] == pytest.approx(sigma_m[2] * (SIGMA_AHEAD_M[4] / SIGMA_AHEAD_M[2]) ** power)


def test_distances_from_many_lanes_are_those_from_each_alone() -> None:
    rng = np.random.default_rng(5)
    x_m, y_m = rng.uniform(-3, 25, 60), rng.uniform(-4, 4, 60)
    lanes = rng.normal([0, 0, 0, 0, 3.4], [0.5, 0.1, 0.05, 0.002, 0.0], (40, 5))
    lanes[:10, 3] = 0.0
    lanes[10:15, 2:4] = 0.0
    alone = [lane_coordinates(x_m, y_m, lane)[1] for lane in lanes]
    assert distances(x_m, y_m, lanes) == pytest.approx(np.array(alone), abs=1e-12)
