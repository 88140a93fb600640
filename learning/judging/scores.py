"""Scores of angles: errors over frames, by the size of the angle, and over time.

An error is predicted - recorded angle, + = to the left of the record. All angles of a call have one unit, degrees
of the road wheel or of the steering wheel; ``wheel_ratio`` converts to the steering wheel where bins are fixed
there.
"""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

Angles = NDArray[np.float64]
Scores = dict[str, float | int | None]

BIN_DEG = 10.0  # of the steering wheel, as in the tables of Deep Steer
SHARP_DEG = 40.0  # likewise: angles beyond are sharp bends
STRAIGHT_DEG = 5.0  # of the steering wheel: straight ahead
LEAST_VARIANCE = 1e-12  # of recorded angles [deg²]; below it is the rounding of a constant
LONGEST_STEP_S = 0.5  # frames farther apart are not successive


def errors(predicted_deg: Angles, true_deg: Angles) -> Scores:
    """MAE, RMSE, mean error, standard deviation of the error, R² and slope of n angles; None where undefined.

    R² = 1 - Σ(p - t)²/Σ(t - t̄)², and the slope is that of the least squares line p(t): below 1, sharp bends are
    predicted too weak.
    """
    error = predicted_deg - true_deg
    n = len(error)
    if n == 0:
        names = ("mae_deg", "rmse_deg", "mean_error_deg", "std_deg", "r2", "slope")
        return {"frames": 0, **dict.fromkeys(names)}
    centred = true_deg - true_deg.mean()
    spread = float(centred @ centred)
    varies = spread > LEAST_VARIANCE * n
    return {
        "frames": n,
        "mae_deg": float(np.abs(error).mean()),
        "rmse_deg": float(np.sqrt(np.mean(error**2))),
        "mean_error_deg": float(error.mean()),
        "std_deg": float(error.std()),
        "r2": 1.0 - float(error @ error) / spread if varies else None,
        "slope": float(centred @ predicted_deg) / spread if varies else None,
    }


def speed_errors(
    predicted_mps: NDArray[np.floating],
    recorded_mps: NDArray[np.floating],
    learned_mps: NDArray[np.floating],
) -> dict[str, float] | None:
    """Errors [m/s] of proposed speeds (n,), beside that of the mean speed of the training at all times.

    ``learned_mps`` (m,) are the speeds of the training. Only frames with both speeds count; None without any.
    """
    both = np.isfinite(predicted_mps) & np.isfinite(recorded_mps)
    if not both.any():
        return None
    error = predicted_mps[both].astype(float) - recorded_mps[both]
    learned = learned_mps[np.isfinite(learned_mps)].astype(float)
    found = {
        "frames": int(both.sum()),
        "rmse_mps": float(np.sqrt(np.mean(error**2))),
        "mae_mps": float(np.abs(error).mean()),
        "mean_error_mps": float(error.mean()),
    }
    if len(learned):
        found["mean_speed_rmse_mps"] = float(np.sqrt(np.mean((learned.mean() - recorded_mps[both]) ** 2)))
    return found


def by_size(
    predicted_deg: Angles, true_deg: Angles, edges_deg: Iterable[float], wheel_ratio: float
) -> list[Scores]:
    """MAE and weakness of the frames whose |recorded steering-wheel angle| lies between two edges; none if empty.

    ``weak_deg`` is the mean of sign(t)·(t - p): how much weaker than recorded bends are predicted, + = too weak.
    """
    size_deg, error = np.abs(true_deg) * wheel_ratio, predicted_deg - true_deg
    weak = -np.sign(true_deg) * error
    found: list[Scores] = []
    for low, high in pairwise(edges_deg):
        inside = (size_deg >= low) & (size_deg < high)
        if inside.any():
            found.append(
                {
                    "from_deg": low,
                    "to_deg": None if math.isinf(high) else high,
                    "frames": int(inside.sum()),
                    "mae_deg": float(np.abs(error[inside]).mean()),
                    "weak_deg": float(weak[inside].mean()),
                }
            )
    return found


def bin_edges_deg(true_deg: Angles, wheel_ratio: float) -> list[float]:
    """Edges of bins of BIN_DEG of the steering wheel that hold all recorded angles."""
    most_deg = float(np.abs(true_deg).max(initial=0.0)) * wheel_ratio
    return [BIN_DEG * number for number in range(math.floor(most_deg / BIN_DEG) + 2)]


def straight_bias_deg(predicted_deg: Angles, true_deg: Angles, wheel_ratio: float) -> float | None:
    """Mean error of the frames with at most STRAIGHT_DEG of the steering wheel; None without any."""
    straight = np.abs(true_deg) * wheel_ratio <= STRAIGHT_DEG
    return float((predicted_deg - true_deg)[straight].mean()) if straight.any() else None


def rate_rms_degps(angles_deg: Angles, t_s: Angles, stretch: NDArray[np.int64]) -> float | None:
    """Root mean square of Δangle/Δt of successive frames of one stretch [deg/s]; None without two."""
    dt_s = np.diff(t_s)
    successive = (np.diff(stretch) == 0) & (dt_s > 0) & (dt_s <= LONGEST_STEP_S)
    if not successive.any():
        return None
    return float(np.sqrt(np.mean((np.diff(angles_deg)[successive] / dt_s[successive]) ** 2)))


def groups(predicted_deg: Angles, true_deg: Angles, names: NDArray[np.str_]) -> dict[str, Scores]:
    """:func:`errors` of each group of frames, by its name."""
    return {
        str(name): errors(predicted_deg[names == name], true_deg[names == name]) for name in np.unique(names)
    }


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
