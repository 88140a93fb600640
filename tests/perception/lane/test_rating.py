from dataclasses import replace

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.model.geometry import KAPPA, PSI, LaneState
from perception.lane.rating import NO_FACTORS, Factors, Rating
from perception.lane.settings import ConfidenceSettings

RATING = Rating(lane_cv_settings())
SURE_LOOKS = lane_cv_settings().evidence.sure_looks
BEST = Factors(1.0, 1.0, 1.0, 1.0, 1.0, one_line=False, by_edges=False)


def features(factors: Factors, looks: int = SURE_LOOKS, heading_rad: float = 0.0, curvature_1pm: float = 0.0):
    mean = np.zeros(6)
    mean[[PSI, KAPPA]] = heading_rad, curvature_1pm
    return RATING.features(factors, LaneState(mean, np.eye(6)), looks=looks)


def probable(factors: Factors, **state: float) -> float:
    return RATING.probability(features(factors, **state))


def test_two_good_lines_are_probable_and_no_lines_are_not():
    assert probable(BEST) > 0.98
    assert probable(NO_FACTORS) < 0.01


@pytest.mark.parametrize("factor", ["support", "plausible", "tight", "sure"])
def test_the_probability_falls_with_every_factor(factor):
    chances = [probable(replace(BEST, **{factor: value})) for value in (1.0, 0.7, 0.4, 0.1)]
    assert (np.diff(chances) < 0).all()


def test_one_line_edges_a_first_detection_and_a_heading_error_reduce_the_probability():
    worse = [
        probable(replace(BEST, one_line=True)),
        probable(replace(BEST, by_edges=True)),
        probable(BEST, looks=1),
        probable(BEST, heading_rad=0.3),
    ]
    assert max(worse) < probable(BEST)


def test_edges_with_similar_ground_on_both_sides_are_less_probable():
    edges = replace(BEST, by_edges=True)
    chances = [probable(replace(edges, apart=nats)) for nats in (4.0, 2.0, 0.0, -1.0)]
    assert (np.diff(chances) < 0).all()


def test_left_and_right_have_the_same_probability():
    left, right = (probable(BEST, heading_rad=side * 0.1, curvature_1pm=side * 0.03) for side in (1, -1))
    assert left == right


def test_there_is_a_weight_for_every_feature():
    count = len(features(BEST))
    assert count == len(ConfidenceSettings.model_fields)
