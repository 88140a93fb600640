import math

import numpy as np
import pytest

from perception.camera.uncertainty import HeightBelief

BELIEF = HeightBelief(1.3, 0.2)


def test_the_hypotheses_are_equally_likely_heights():
    drawn = 1.3 * np.exp(0.2 * np.random.default_rng(1).normal(size=200_000))
    quarters = np.split(np.sort(drawn), 4)
    assert BELIEF.hypotheses_m == pytest.approx([np.median(quarter) for quarter in quarters], rel=0.01)


def test_a_lane_width_moves_the_height_towards_the_one_that_fits_and_narrows_the_belief():
    true_m = 1.6
    after = BELIEF.given_width(3.4 / true_m, width_m=3.4, width_sigma_m=0.35)
    assert after.median_m == pytest.approx(true_m, rel=0.06) and after.median_m < true_m
    assert after.sigma < 0.1


def test_the_belief_after_a_width_is_the_product_of_both_densities():
    after = BELIEF.given_width(2.2, width_m=3.4, width_sigma_m=0.35)
    log_h = np.linspace(math.log(0.4), math.log(4.0), 20_001)
    density = np.exp(
        -0.5 * ((log_h - math.log(1.3)) / 0.2) ** 2
        - 0.5 * ((log_h - math.log(3.4 / 2.2)) / (0.35 / 3.4)) ** 2
    )
    mean = np.average(log_h, weights=density)
    assert math.log(after.median_m) == pytest.approx(mean, abs=1e-4)
    assert after.sigma == pytest.approx(np.sqrt(np.average((log_h - mean) ** 2, weights=density)), abs=1e-4)


def test_the_width_of_a_road_of_two_lanes_does_not_change_the_belief():
    assert BELIEF.given_width(7.0 / 1.3, width_m=3.4, width_sigma_m=0.35) == BELIEF
