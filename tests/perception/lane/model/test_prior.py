"""The prior of a straight road: when it applies, and its effect on a lane."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.estimators import lane_cv_settings
from perception.lane.model.geometry import KAPPA, KAPPA_RATE, PITCH, PSI, WIDTH, E, LaneState
from perception.lane.model.prior import looks_straight, on_straight

PRIOR = lane_cv_settings().prior
SIGMA = np.array([0.02, 0.004, 0.0009, 0.00005, 0.03, 0.003])  # of a well detected lane
MIRROR = np.diag([-1.0, -1.0, -1.0, -1.0, 1.0, 1.0])


def random_covariance(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return root @ root.T + 1e-3 * np.eye(6)


def seen_lane(seed: int, *, bend_1pm: float = 0.0, heading_rad: float = 0.0) -> LaneState:
    """A lane with the usual deviations and random correlations."""
    random = random_covariance(seed)
    scale = SIGMA / np.sqrt(np.diag(random))
    mean = np.zeros(6)
    mean[[PSI, KAPPA, WIDTH]] = heading_rad, bend_1pm, 3.4
    return LaneState(mean=mean, covariance=random * np.outer(scale, scale))


@pytest.mark.parametrize(
    ("bend_1pm", "straight"), [(0.0, True), (0.0015, True), (0.006, False), (0.02, False)]
)
@pytest.mark.parametrize("side", [1, -1])
def test_a_road_bends_if_its_curvature_exceeds_the_uncertainty(
    bend_1pm: float, straight: bool, side: int
) -> None:
    lane = LaneState(mean=side * bend_1pm * np.eye(6)[KAPPA], covariance=np.diag(SIGMA**2))
    assert looks_straight(lane, PRIOR, log_odds=3.0) == straight


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.02, 0.02))
def test_the_test_for_a_straight_road_agrees_with_numpy_and_is_symmetric(seed: int, bend_1pm: float) -> None:
    lane = seen_lane(seed, bend_1pm=bend_1pm)
    own = [KAPPA, KAPPA_RATE]

    def log_density(*sigma: float) -> float:
        spread = lane.covariance[np.ix_(own, own)] + np.diag(np.square(sigma))
        sign, log_determinant = np.linalg.slogdet(spread)
        assert sign > 0
        return -0.5 * float(lane.mean[own] @ np.linalg.solve(spread, lane.mean[own]) + log_determinant)

    margin = log_density(
        PRIOR.straight_curvature_sigma_1pm, PRIOR.straight_curvature_rate_sigma_1pm2
    ) - log_density(PRIOR.curvature_sigma_1pm, PRIOR.curvature_rate_sigma_1pm2)
    mirrored = LaneState(mean=MIRROR @ lane.mean, covariance=MIRROR @ lane.covariance @ MIRROR)
    for log_odds in (-margin - 0.01, -margin + 0.01):
        assert looks_straight(lane, PRIOR, log_odds=log_odds) == (log_odds > -margin)
        assert looks_straight(mirrored, PRIOR, log_odds=log_odds) == (log_odds > -margin)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.002, 0.002), st.floats(-0.05, 0.05))
def test_a_lane_on_a_straight_road_is_the_product_of_both_gaussians(
    seed: int, bend_1pm: float, heading_rad: float
) -> None:
    lane = seen_lane(seed, bend_1pm=bend_1pm, heading_rad=heading_rad)
    known = np.zeros(6)
    known[KAPPA] = PRIOR.straight_curvature_sigma_1pm**-2
    known[KAPPA_RATE] = PRIOR.straight_curvature_rate_sigma_1pm2**-2
    information = np.linalg.inv(lane.covariance) + np.diag(known)
    mean = np.linalg.solve(information, np.linalg.solve(lane.covariance, lane.mean))
    straight = on_straight(lane, PRIOR)
    assert straight.mean == pytest.approx(mean, rel=1e-5, abs=1e-9)
    scale = np.outer(SIGMA, SIGMA)
    assert straight.covariance / scale == pytest.approx(np.linalg.inv(information) / scale, abs=1e-5)
    assert (straight.covariance == straight.covariance.T).all()
    assert abs(straight.mean[KAPPA]) <= abs(bend_1pm) + 1e-12


def test_removing_the_bend_moves_a_correlated_heading() -> None:
    covariance = np.diag(SIGMA**2)
    covariance[PSI, KAPPA] = covariance[KAPPA, PSI] = 0.9 * SIGMA[PSI] * SIGMA[KAPPA]
    lane = LaneState(mean=np.array([0.0, 0.004, 0.0009, 0.0, 3.4, 0.0]), covariance=covariance)
    straight = on_straight(lane, PRIOR)
    assert 0.0 < straight.mean[PSI] < 0.003
    assert straight.covariance[PSI, PSI] < covariance[PSI, PSI]
    assert straight.mean[[E, WIDTH, PITCH]] == pytest.approx(lane.mean[[E, WIDTH, PITCH]])
