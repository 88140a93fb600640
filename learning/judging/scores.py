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
