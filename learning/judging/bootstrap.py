"""Confidence intervals of scores of successive frames, whose errors are correlated."""

import numpy as np

from learning.judging.scores import Angles

BLOCK_S = 10.0  # longer than a driver's correction or a bend of a track
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
    """Intervals of MAE, RMSE, mean error and R² at ``level``; None with fewer than two blocks or a constant record.

    Circular block bootstrap (Politis and Romano, A circular block-resampling procedure for stationary data, 1992):
    runs of ``block`` successive frames are drawn with replacement, so that correlation within a run is kept;
    percentiles of the replicates.
    """
    n, names = len(true_deg), ("mae_deg", "rmse_deg", "mean_error_deg", "r2")
    if n < 2 * block:
        return dict.fromkeys(names)
    error = predicted_deg - true_deg
    terms = np.stack([np.abs(error), error**2, error, true_deg, true_deg**2])
    cyclic = np.concatenate([terms, terms[:, : block - 1]], axis=1)
    total = np.concatenate([np.zeros((len(terms), 1)), np.cumsum(cyclic, axis=1)], axis=1)
    sums = total[:, block:] - total[:, :-block]  # of the block that begins at each frame
    starts = np.random.default_rng(seed).integers(0, n, (replicates, -(-n // block)))
    means = sums[:, starts].mean(axis=2) / block
    spread = means[4] - means[3] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        r2 = 1 - means[1] / spread
    found = dict(zip(names, (means[0], np.sqrt(means[1]), means[2], r2), strict=True))
    tail = 50 * (1 - level)
    return {name: _between(values, tail) for name, values in found.items()}


def _between(values: Angles, tail: float) -> Interval | None:
    if not np.isfinite(values).all():
        return None
    low, high = np.percentile(values, [tail, 100 - tail])
    return float(low), float(high)


def block_frames(t_s: Angles) -> int:
    """Number of frames in BLOCK_S, from the median time between frames; at least 1."""
    steps_s = np.diff(t_s)
    steps_s = steps_s[steps_s > 0]
    return max(1, round(BLOCK_S / float(np.median(steps_s)))) if len(steps_s) else 1
