"""The factor of the interval, from errors in the order of time."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from learning.training.calibrate import BLOCKS, block_quantile


def test_the_interval_of_errors_that_are_alike_everywhere_is_their_quantile():
    ratios = np.random.default_rng(0).permutation(np.linspace(0, 1, 2001))
    assert block_quantile(ratios, 0.9) == pytest.approx(0.9, abs=0.02)


def test_the_interval_covers_a_new_stretch_more_often_than_the_quantile_of_all_frames_does():
    rng, length = np.random.default_rng(2), 60
    plain, ours = [], []
    for _ in range(300):
        spread = rng.lognormal(0, 1.0, BLOCKS + 1)  # errors differ from stretch to stretch
        ratios = np.abs(rng.normal(size=(BLOCKS + 1, length))) * spread[:, None]
        known, new = ratios[:-1].ravel(), ratios[-1]
        plain.append((new <= np.quantile(known, 0.9)).mean())
        ours.append((new <= block_quantile(known, 0.9)).mean())
    assert np.mean(plain) < np.mean(ours) == pytest.approx(0.9, abs=0.02)


def test_a_few_errors_give_the_greatest():
    assert block_quantile(np.array([0.2]), 0.9) == 0.2
    assert block_quantile(np.array([0.3, 0.1, 0.2]), 0.9) == 0.3


def test_an_interval_of_exact_answers_is_positive():
    assert block_quantile(np.zeros(40), 0.9) > 0
