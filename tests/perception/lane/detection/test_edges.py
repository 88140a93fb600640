from functools import cache

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.model.geometry import KAPPA, PSI, WIDTH, E
from perception.lane.view import make_view
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

HALF_M = 2.0  # of a road
ON_ROAD, BESIDE = 1.5, -2.0  # log-likelihood of road [nats]


@cache
def finder():
    view = make_view(lane_cv_settings(), load(CONFIG_DIR / "camera.yaml", Camera))
    assert view is not None
    return view.edges


def road(offset_m=0.0, heading_rad=0.0, curvature_1pm=0.0):
    state = np.zeros(6)
    state[[E, PSI, KAPPA, WIDTH]] = offset_m, heading_rad, curvature_1pm, 2 * HALF_M
    return state


def likelihood_sums(*, on_road=ON_ROAD, beside=BESIDE, shift_m=0.0):
    """∫ of the likelihood from the left end of the grid, of a straight road whose middle is ``shift_m`` left."""
    left_m = np.arange(10.0, -10.0 - 1e-9, -lane_cv_settings().edges.step_m)
    wide_m = np.clip(shift_m + HALF_M - left_m, 0, 2 * HALF_M)
    sums = on_road * wide_m + beside * (left_m[0] - left_m - wide_m)
    return np.tile(sums.astype(np.float32), (len(finder().grid.ahead_m), 1))


def test_the_contrast_of_a_road_is_the_difference_of_the_likelihoods_inside_and_beside_it():
    assert finder().apart(likelihood_sums(), road()) == pytest.approx(ON_ROAD - BESIDE, abs=0.05)


def test_equal_ground_on_both_sides_of_an_edge_has_no_contrast():
    assert finder().apart(likelihood_sums(beside=ON_ROAD), road()) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("aside_m", [0.5, 1.0, -1.0])
def test_edges_next_to_the_true_ones_have_less_contrast(aside_m):
    apart = finder().apart(likelihood_sums(), road(offset_m=aside_m))
    assert apart < 0.8 * (ON_ROAD - BESIDE)


def test_left_and_right_have_the_same_contrast():
    one, other = (
        finder().apart(likelihood_sums(shift_m=side * 0.6), road(offset_m=-side * 0.3)) for side in (1, -1)
    )
    assert one == pytest.approx(other, abs=0.05)


def test_a_road_without_visible_sides_has_no_contrast():
    wide = road()
    wide[WIDTH] = 60.0
    assert finder().apart(likelihood_sums(), wide) == 0.0
