"""The running mean forgets by way or time as an exponential does."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supervisor.inputs.consistency import RunningMean

VALUES = st.lists(st.floats(0.0, 10.0), min_size=1, max_size=20)


@given(VALUES)
def test_both_forms_of_the_update_agree(values: list[float]) -> None:
    one = other = RunningMean(0.5)
    for value in values:
        one, other = one.after(value, 0.3, length=10.0), other.moved_mean(value, 0.3, length=10.0)
    assert one.mean == pytest.approx(other.mean, abs=1e-12)


def test_a_constant_value_is_reached_as_one_minus_an_exponential() -> None:
    mean = RunningMean(0.0)
    for _ in range(40):
        mean = mean.moved_mean(1.0, 0.25, length=20.0)
    assert mean.mean == pytest.approx(1 - math.exp(-10.0 / 20.0))


def test_a_first_value_outweighs_a_prior_of_small_weight() -> None:
    prior = RunningMean(0.2 * 0.05, 0.2)
    assert prior.mean == pytest.approx(0.05)
    assert prior.after(1.0, 10.0, length=10.0).mean > 0.8
