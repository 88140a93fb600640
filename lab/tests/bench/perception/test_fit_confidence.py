import numpy as np
import pytest

from lab.bench.perception.fit_confidence import fit_weights


def test_the_fit_recovers_the_weights_of_the_data():
    rng = np.random.default_rng(1)
    made = np.array([1.0, 2.0, -1.5])
    inputs = np.column_stack([np.ones(20_000), rng.normal(size=(20_000, 2))])
    right = (rng.random(20_000) < 1 / (1 + np.exp(-inputs @ made))).astype(float)
    assert fit_weights(inputs, right) == pytest.approx(made, abs=0.1)
