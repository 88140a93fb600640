"""What is remembered of a lane stays a proper Gaussian, however it is bounded."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.lane_tracker import at_most_sigma


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.floats(0.05, 5.0))
def test_a_bounded_deviation_keeps_the_covariance_positive_definite(
    seed: int, index: int, sigma: float
) -> None:
    root = np.random.default_rng(seed).normal(size=(6, 6))
    covariance = root @ root.T + 1e-3 * np.eye(6)
    bounded = at_most_sigma(covariance, index, sigma)
    assert np.linalg.eigvalsh(bounded).min() > 0
    assert bounded[index, index] == pytest.approx(min(covariance[index, index], sigma**2))
    others = np.delete(np.arange(6), index)
    assert (bounded[np.ix_(others, others)] == covariance[np.ix_(others, others)]).all()
