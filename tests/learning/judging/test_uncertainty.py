"""Bootstrap intervals, coverage, and the order of errors, compared with closed forms."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from learning.judging.evaluate import calibration, coverage, risk_coverage, world
from learning.judging.scores import block_frames, intervals


def width(interval: tuple[float, float]) -> float:
    return interval[1] - interval[0]


def test_of_independent_errors_the_interval_of_the_mean_is_that_of_the_normal_law():
    error = np.random.default_rng(0).normal(0.5, 2.0, 1000)
    low, high = intervals(error, np.zeros(1000), block=1)["mean_error_deg"]
    half = 1.96 * error.std() / np.sqrt(1000)
    assert (low, high) == pytest.approx((error.mean() - half, error.mean() + half), abs=0.15 * half)


def test_the_interval_of_the_mean_absolute_error_agrees_with_scipy():
    error = np.random.default_rng(1).normal(0.0, 2.0, 600)
    ours = intervals(error, np.zeros(600), block=1)["mae_deg"]
    theirs = stats.bootstrap((np.abs(error),), np.mean, method="percentile", rng=0).confidence_interval
    assert ours == pytest.approx(tuple(theirs), abs=0.02)


def test_of_correlated_errors_the_interval_widens_by_the_long_run_variance():
    random, rho, n = np.random.default_rng(2), 0.9, 6000
    error = np.zeros(n)
    for k in range(1, n):
        error[k] = rho * error[k - 1] + random.normal()
    found = [intervals(error, np.zeros(n), block=b, replicates=500)["mean_error_deg"] for b in (1, 100)]
    assert width(found[1]) / width(found[0]) == pytest.approx(np.sqrt((1 + rho) / (1 - rho)), rel=0.25)


def test_intervals_contain_the_scores_and_short_drives_have_none():
    random = np.random.default_rng(3)
    true = np.cumsum(random.normal(0, 1, 900))
    predicted = true + random.normal(0, 1, 900)
    found = intervals(predicted, true, block=30)
    assert found["mae_deg"][0] < np.abs(predicted - true).mean() < found["mae_deg"][1]
    assert found["rmse_deg"][0] < 1.0 < found["rmse_deg"][1] and found["r2"][1] <= 1.0
    assert set(intervals(predicted[:299], true[:299], block=30).values()) == {None}


def remembering(seed: int, n: int) -> np.ndarray:
    """Errors of mean 0 and deviation 1 whose correlation falls by 1/e in 20 frames."""
    rho = np.exp(-1 / 20)
    noise = np.random.default_rng(seed).normal(0.0, np.sqrt(1 - rho**2), n + 200)
    return lfilter([1.0], [1.0, -rho], noise)[200:]


@pytest.mark.parametrize("n", [1000, 2000])
def test_about_95_percent_of_the_intervals_of_correlated_errors_contain_the_true_mean(n):
    trials = 300
    found = [
        intervals(remembering(seed, n), np.zeros(n), block=100, replicates=500)["mean_error_deg"]
        for seed in range(trials)
    ]
    assert 0.93 <= sum(low <= 0.0 <= high for low, high in found) / trials <= 0.975


def test_one_frame_more_than_ten_blocks_does_not_narrow_the_interval():
    error = np.concatenate([remembering(seed, 1001) for seed in range(30)]).reshape(30, 1001)
    ten, more = (
        np.mean([width(intervals(one[:n], np.zeros(n), block=100)["mean_error_deg"]) for one in error])
        for n in (1000, 1001)
    )
    assert more == pytest.approx(ten, rel=0.02)


def test_a_constant_record_has_no_interval_of_r2():
    true = np.full(600, 0.3 * 180 / np.pi)
    predicted = true + np.random.default_rng(0).normal(0.0, 1.0, 600)
    found = intervals(predicted, true, block=10)
    assert found["r2"] is None and found["mae_deg"] is not None


def test_a_block_lasts_ten_seconds_at_the_rate_of_the_frames():
    assert block_frames(np.arange(0, 60, 0.05)) == 200
    assert block_frames(np.array([3.0])) == 1


def test_coverage_is_the_share_of_errors_within_the_interval():
    error = np.random.default_rng(4).normal(0.0, 2.0, 50_000)
    found = coverage(error, np.full(50_000, 2.0 * stats.norm.ppf(0.95)))
    assert found["coverage_90"] == pytest.approx(0.9, abs=0.005)
    assert found["mean_width_deg"] == pytest.approx(2 * 2.0 * stats.norm.ppf(0.95))


def test_a_sigma_in_the_order_of_the_errors_reaches_the_oracle_and_a_random_one_the_mean():
    random = np.random.default_rng(5)
    error = random.normal(0.0, 1.0, 5000)
    best = risk_coverage(error, np.abs(error))
    chance = risk_coverage(error, random.random(5000))
    assert best["aurc_deg"] == best["oracle_aurc_deg"] and best["spearman"] == pytest.approx(1.0)
    assert best["mae_deg_at"]["1"] == pytest.approx(np.abs(error).mean())
    assert chance["aurc_deg"] == pytest.approx(np.abs(error).mean(), rel=0.1)
    assert abs(chance["spearman"]) < 0.05
    assert risk_coverage(error[:5], error[:5]) is None


def test_heteroscedastic_errors_are_smaller_where_sigma_is():
    random = np.random.default_rng(6)
    sigma = random.uniform(0.1, 4.0, 5000)
    at = risk_coverage(random.normal(0.0, sigma), sigma)["mae_deg_at"]
    assert at["0.1"] == pytest.approx(np.quantile(sigma, 0.05) * np.sqrt(2 / np.pi), rel=0.2)
    assert [*at.values()] == sorted(at.values(), reverse=True)


def test_confidence_and_world_are_compared_with_the_errors():
    error = np.array([0.0, 0.01, -0.05, 0.2])
    found = calibration(error, np.array([0.9, 0.9, 0.5, 0.1]), 0.035)
    assert found == {"mean_confidence": pytest.approx(0.6), "within_tolerance": 0.5}
    apart = world(np.array([1.0, -3.0]), np.array([0.9, 1.1]))
    assert apart == {"outside": 0.5, "mae_inside_deg": 1.0, "mae_outside_deg": 3.0}
    assert world(np.array([1.0]), np.array([2.0]))["mae_inside_deg"] is None
