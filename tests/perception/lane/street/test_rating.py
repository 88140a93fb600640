import pytest

from perception.estimators import lane_cv_settings
from perception.lane.detection.marks import Marks
from perception.lane.street.rating import (
    MAX_LOGIT,
    MAX_OFFSET_M,
    either,
    logit,
    probability_of,
    searched_features,
    street_features,
)
from perception.lane.street.settings import SearchedWeights, StreetWeights

SETTINGS = lane_cv_settings().street
CLEAN = Marks(rough=0.0, inside=0.0, along=1.0)
SEARCHED = dict(marked=True, offset_m=0.1, agreement=1.0, street=0.8, shown=1.0, marks=CLEAN)
PAIRED = dict(steps=0, uneven=0.0, offset_m=0.1, agreement=1.0, searched=0.8, shown=1.0, along=1.0)


def by_search(probability=0.9, **changes):
    return probability_of(searched_features(probability, **SEARCHED | changes), SETTINGS.searched)


def by_pair(probability=0.9, **changes):
    return probability_of(street_features(probability, **PAIRED | changes), SETTINGS.pair)


@pytest.mark.parametrize("probability", [0.01, 0.5, 0.9])
def test_logit_is_the_inverse_of_the_logistic_function(probability):
    weights = SearchedWeights(**dict.fromkeys(SearchedWeights.model_fields, 0.0) | {"probability": 1.0})
    assert probability_of(searched_features(probability, **SEARCHED), weights) == pytest.approx(probability)


def test_certainty_counts_as_a_limited_logit():
    assert logit(0.0) == -MAX_LOGIT and logit(1.0) == pytest.approx(MAX_LOGIT)


def test_each_weight_has_its_feature():
    assert len(searched_features(0.5, **SEARCHED)) == len(SearchedWeights.model_fields)
    assert len(street_features(0.5, **PAIRED)) == len(StreetWeights.model_fields)


@pytest.mark.parametrize("rated", [by_search, by_pair])
def test_a_lane_that_both_finders_have_is_more_probable_than_one_that_they_dispute(rated):
    assert rated(agreement=1.0) > rated(agreement=0.5) > rated(agreement=0.0)


@pytest.mark.parametrize("rated", [by_search, by_pair])
def test_a_car_far_from_the_middle_of_its_lane_is_less_probable_on_either_side(rated):
    assert rated(offset_m=0.0) > rated(offset_m=0.8)
    assert rated(offset_m=-0.8) == rated(offset_m=0.8)
    assert rated(offset_m=50.0) == rated(offset_m=MAX_OFFSET_M)


@pytest.mark.parametrize("rated", [by_search, by_pair])
def test_a_lane_that_its_finder_doubts_is_less_probable(rated):
    assert rated(0.9) > rated(0.4) > rated(0.05)


def test_a_pair_of_steps_or_across_two_surfaces_is_less_probable_than_one_of_lines():
    assert by_pair(steps=0) > by_pair(steps=1) > by_pair(steps=2)
    assert by_pair(uneven=0.0) > by_pair(uneven=1.5)


def test_one_of_two_lanes_is_right_as_often_as_the_better_one_at_least():
    assert either(0.6, 0.9, agreement=0.0) == pytest.approx(0.6)
    assert either(0.6, 0.5, agreement=1.0) == pytest.approx(0.8)
    assert either(0.0, 0.5, agreement=0.5) == pytest.approx(0.25)


@pytest.mark.parametrize("rated", [by_search, by_pair])
def test_a_lane_whose_boundaries_are_not_visible_is_less_probable(rated):
    assert rated(shown=1.0) > rated(shown=0.3) > rated(shown=0.0)


@pytest.mark.parametrize("doubt", [{"rough": 1.0}, {"inside": 0.5}, {"along": 0.2}])
def test_marks_that_the_boundaries_do_not_explain_and_boundaries_without_paint_make_a_lane_less_probable(
    doubt,
):
    assert by_search(marks=CLEAN._replace(**doubt)) < by_search(marks=CLEAN)


def test_a_pair_with_paint_along_both_boundaries_is_more_probable():
    assert by_pair(along=1.0) > by_pair(along=0.3) > by_pair(along=0.0)
