"""Where the support of a lane by points ends: the last place that is not covered by chance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.estimators import lane_cv_settings
from perception.lane.model.evidence import support_end_m

SHARE = lane_cv_settings().evidence.full_excess
AHEAD_M = np.arange(45.0, 4.0, -0.5)  # far to near
SHOWN = np.ones((2, len(AHEAD_M)), bool)


def end_m(covered: np.ndarray, *, chance: float = 0.05, visible: np.ndarray = SHOWN) -> float:
    return support_end_m(covered, visible, AHEAD_M, chance=chance, share=SHARE)


@given(last=st.integers(0, len(AHEAD_M) - 1), sides=st.sampled_from([(0,), (1,), (0, 1)]))
def test_a_line_that_is_covered_without_gaps_ends_at_its_farthest_band(last, sides):
    covered = np.zeros_like(SHOWN)
    for side in sides:
        covered[side, last:] = True
    assert end_m(covered) == AHEAD_M[last]


def test_of_two_boundaries_the_farther_end_counts():
    covered = np.zeros_like(SHOWN)
    covered[0, 60:], covered[1, 20:] = True, True
    assert end_m(covered) == end_m(covered[::-1]) == AHEAD_M[20]


@pytest.mark.parametrize("gap", [4, 12])
def test_a_line_goes_on_behind_the_gap_of_its_dashes(gap):
    covered = (np.arange(len(AHEAD_M)) // gap % 2 == 0)[None] & SHOWN
    assert end_m(covered) >= AHEAD_M[0] - gap * 0.5


def test_without_points_nothing_is_supported():
    assert end_m(np.zeros_like(SHOWN)) == 0.0


def test_bands_outside_the_image_neither_support_a_lane_nor_end_it():
    covered, visible = np.zeros_like(SHOWN), SHOWN.copy()
    covered[:, 30:50], visible[:, 50:] = True, False
    assert end_m(covered, visible=visible) == AHEAD_M[30]


@pytest.mark.parametrize("chance", [0.02, 0.1])
def test_points_by_chance_behind_a_line_move_its_end_little(chance):
    rng, off_m = np.random.default_rng(3), []
    for _ in range(200):
        covered = rng.random(SHOWN.shape) < chance
        covered[:, 45:] = True
        off_m.append(end_m(covered, chance=chance) - AHEAD_M[45])
    assert np.median(off_m) <= 2.0 and np.percentile(off_m, 90) < 12.0
