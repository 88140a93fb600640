from dataclasses import replace

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.confidence import ConfidenceSettings, confidence, grounds
from perception.lane.evidence import NO_BELIEF, Belief
from sim_harness.bench.perception.fit_confidence import fitted

WEIGHTS = lane_cv_settings().confidence
SURE = Belief(1.0, 1.0, 1.0, 1.0, 1.0, one_line=False, by_edges=False)


def believed(
    belief: Belief, *, looks: float = 1.0, heading_rad: float = 0.0, curvature_1pm: float = 0.0
) -> float:
    return confidence(
        grounds(belief, looks=looks, heading_rad=heading_rad, curvature_1pm=curvature_1pm), WEIGHTS
    )


def test_two_good_lines_are_believed_and_nothing_is_not():
    assert believed(SURE) > 0.98
    assert believed(NO_BELIEF) < 0.01


@pytest.mark.parametrize("factor", ["support", "plausible", "tight", "sure"])
def test_less_of_any_evidence_is_believed_less(factor):
    chances = [believed(replace(SURE, **{factor: value})) for value in (1.0, 0.7, 0.4, 0.1)]
    assert (np.diff(chances) < 0).all()


def test_one_line_edges_a_first_look_and_a_lane_askew_are_believed_less():
    doubtful = [
        believed(replace(SURE, one_line=True)),
        believed(replace(SURE, by_edges=True)),
        believed(SURE, looks=0.1),
        believed(SURE, heading_rad=0.3),
    ]
    assert max(doubtful) < believed(SURE)


def test_the_more_alike_both_sides_of_the_edges_are_the_less_they_are_believed():
    edges = replace(SURE, by_edges=True)
    chances = [believed(replace(edges, apart=nats)) for nats in (4.0, 2.0, 0.0, -1.0)]
    assert (np.diff(chances) < 0).all()


def test_left_and_right_are_alike():
    assert believed(SURE, heading_rad=0.1, curvature_1pm=0.03) == believed(
        SURE, heading_rad=-0.1, curvature_1pm=-0.03
    )


def test_the_fit_finds_the_weights_that_made_the_chances():
    rng = np.random.default_rng(1)
    made = np.array([1.0, 2.0, -1.5])
    rests_on = np.column_stack([np.ones(20_000), rng.normal(size=(20_000, 2))])
    right = (rng.random(20_000) < 1 / (1 + np.exp(-rests_on @ made))).astype(float)
    assert fitted(rests_on, right) == pytest.approx(made, abs=0.1)


def test_there_is_a_weight_for_every_ground():
    count = len(grounds(SURE, looks=1.0, heading_rad=0.0, curvature_1pm=0.0))
    assert count == len(ConfidenceSettings.model_fields)
