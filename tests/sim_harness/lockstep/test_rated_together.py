"""A second estimator that the rules rate as `cv` does not slow a car where it is less sure."""

import pytest

import trepid
from sim_harness.judging.trace import Trace


def drive(*estimators: str) -> Trace:
    """Six seconds on a road without lines, of which `arcs` is less sure."""
    settings = {"estimators": list(estimators), "duration_s": 6}
    return trepid.run("unmarked_bend", seed=0, settings=settings).trace


@pytest.mark.long
def test_cv_beside_less_sure_arcs_is_as_fast_as_cv_alone_and_no_more_afraid():
    alone, beside = drive("cv"), drive("cv", "arcs")
    assert (beside["arcs.confidence"][-50:] < 0.7 * beside["cv.confidence"][-50:]).all()
    assert beside["speed_mps"].mean() >= alone["speed_mps"].mean()
    assert beside["decision.fear"].mean() <= alone["decision.fear"].mean()
