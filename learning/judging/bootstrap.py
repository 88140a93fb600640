"""Confidence intervals of scores of successive frames, whose errors are correlated."""

import math

import numpy as np
from scipy.special import ndtr, stdtrit

from learning.judging.scores import LEAST_VARIANCE, Angles

BLOCK_S = 10.0  # longer than a driver's correction or a bend of a track
LEAST_BLOCKS = 10
REPLICATES = 2000
LEVEL = 0.95

Interval = tuple[float, float]


def intervals(
    predicted_deg: Angles,
    true_deg: Angles,
    *,
    block: int,
    replicates: int = REPLICATES,
    level: float = LEVEL,
    seed: int = 0,
) -> dict[str, Interval | None]:
    """Intervals of MAE, RMSE, mean error and R² at ``level``; None with fewer than LEAST_BLOCKS blocks of frames.

    Circular block bootstrap (Politis and Romano, A circular block-resampling procedure for stationary data, 1992):
    runs of ``block`` successive frames are drawn with replacement up to the number of frames, so that correlation
    within a run is kept. The interval lies between two percentiles of the replicates; Student's t of the number of
    blocks chooses them (Hesterberg, What Teachers Should Know About the Bootstrap, 2015). Correlation across the
    ends of blocks is lost, a share of the variance that halves with twice the block; the replicates of half blocks
    give it. R² has no interval where a replicate has a constant record.
    """
    blocks = len(true_deg) / block
    if blocks < LEAST_BLOCKS:
        return dict.fromkeys(("mae_deg", "rmse_deg", "mean_error_deg", "r2"))
    error, centred = predicted_deg - true_deg, true_deg - true_deg.mean()
    terms = np.stack([np.abs(error), error**2, error, centred, centred**2])
    found, short = (_scores(_means(terms, size, replicates, seed)) for size in (block, max(1, block // 2)))
    normal = math.sqrt(blocks / (blocks - 1)) * float(stdtrit(blocks - 1, 0.5 * (1 + level)))
    return {name: _between(found[name], normal * _lost(found[name], short[name])) for name in found}


def _means(terms: Angles, block: int, replicates: int, seed: int) -> Angles:
    """The means (terms, replicates) of n frames of drawn blocks; the last block is cut to n."""
    n = terms.shape[1]
    count = -(-n // block)
    starts = np.random.default_rng(seed).integers(0, n, (replicates, count))
    ends = starts + block
    ends[:, -1] -= count * block - n
    cyclic = np.concatenate([terms, terms[:, : block - 1]], axis=1)
    total = np.concatenate([np.zeros((len(terms), 1)), np.cumsum(cyclic, axis=1)], axis=1)
    return np.stack([(one[ends] - one[starts]).sum(axis=1) / n for one in total])


def _scores(means: Angles) -> dict[str, Angles]:
    """The scores of replicates by the means of |e|, e², e, t and t² of the error e and the angle t."""
    variance = means[4] - means[3] ** 2
    r2 = np.full(len(variance), math.nan)
    np.divide(means[1], variance, out=r2, where=variance > LEAST_VARIANCE)
    return {"mae_deg": means[0], "rmse_deg": np.sqrt(means[1]), "mean_error_deg": means[2], "r2": 1 - r2}


def _lost(found: Angles, short: Angles) -> float:
    """The spread without ends of blocks over that of ``found``, at least 1; ``short``: of half blocks."""
    variance = float(found.var())
    return math.sqrt(max(1.0, 2.0 - float(short.var()) / variance)) if variance > 0 else 1.0


def _between(values: Angles, normal: float) -> Interval | None:
    """The percentiles of ``values`` that a normal law has at ±``normal`` standard deviations."""
    if not np.isfinite(values).all():
        return None
    tail = 100 * float(ndtr(-normal))
    low, high = np.percentile(values, [tail, 100 - tail])
    return float(low), float(high)


def block_frames(t_s: Angles) -> int:
    """Number of frames in BLOCK_S, from the median time between frames; at least 1."""
    steps_s = np.diff(t_s)
    steps_s = steps_s[steps_s > 0]
    return max(1, round(BLOCK_S / float(np.median(steps_s)))) if len(steps_s) else 1
