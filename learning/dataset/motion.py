"""Labels against the motion of the car: their delay, and labels that contradict it.

The motion is the recorded yaw rate, or without it the shift of the view between frames (:mod:`likeness`), both
positive while the car turns left. The delay is the lag of the greatest correlation r(lag) of label(t) with
motion(t + lag): > 0, the car turns after the label. A suspicious label is far from what the motion around it gives:

    label(t) ~ Σ_k w_k·motion(t + k)        k from -BEFORE to AFTER frames, ridge regression

cross-validated over FOLDS of neighbouring frames; the residual exceeds SUSPICIOUS times the robust spread
1.4826·median|residual| of the data set.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import Rows, middle_rows
from trepid.types import Array, Column, Mask

LAGS_S = 1.0
LEAST_CORRELATION = 0.3
LEAST_FRAMES = 200
BEFORE, AFTER = 4, 15
FOLDS, BLOCKS = 5, 20
RIDGE = 1e-3
SUSPICIOUS = 5.0


@dataclass(frozen=True, slots=True)
class Delay:
    """Of the motion after the label."""

    delay_s: float | None  # None: label and motion are not related enough
    correlation: float | None  # at this delay; negative: the sign of the labels is reversed
    by: str  # "yaw rate" or "shift of the view"


def motion_of(rows: Rows) -> tuple[Column, str]:
    """The motion of each row, and its name; NaN where it is not known."""
    yaw = rows["yaw_rate_radps"].astype(np.float64)
    if np.isfinite(yaw).mean() > 0.5:
        return yaw, "yaw rate"
    step_s = np.diff(rows["t_s"], prepend=np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(step_s > 0, rows["shift"] / step_s, np.nan), "shift of the view"


def delay_of(rows: Rows) -> Delay:
    """The delay of the motion after the recorded labels."""
    rows = middle_rows(rows)
    motion, by = motion_of(rows)
    label, stretch = rows["road_wheel_rad"], rows["stretch"]
    step_s = np.diff(rows["t_s"])
    usual = step_s[(step_s > 0) & (stretch[1:] == stretch[:-1])]
    known = np.isfinite(motion) & np.isfinite(label)
    if known.sum() < LEAST_FRAMES or not len(usual):
        return Delay(None, None, by)
    period_s = float(np.median(usual))
    most = min(max(1, round(LAGS_S / period_s)), len(rows) - 1)
    motion = np.clip(motion, *np.nanpercentile(motion, (1, 99)))
    found = np.array([_correlation(label, motion, stretch, lag) for lag in range(-most, most + 1)])
    if not np.isfinite(found).any():
        return Delay(None, None, by)
    best = int(np.nanargmax(np.abs(found)))
    correlation = float(found[best])
    if abs(correlation) < LEAST_CORRELATION:
        return Delay(None, correlation, by)
    return Delay((best - most + _peak(np.abs(found), best)) * period_s, correlation, by)


def _correlation(label: Column, motion: Column, stretch: NDArray[np.int32], lag: int) -> float:
    """Correlation of label(t) with motion(t + lag) inside stretches; NaN where there is none."""
    ahead, behind = (
        slice(max(0, lag), len(label) + min(0, lag)),
        slice(max(0, -lag), len(label) - max(0, lag)),
    )
    a, b = label[behind], motion[ahead]
    used = (stretch[behind] == stretch[ahead]) & np.isfinite(a) & np.isfinite(b)
    if used.sum() < LEAST_FRAMES // 2 or not a[used].std() or not b[used].std():
        return math.nan
    return float(np.corrcoef(a[used], b[used])[0, 1])


def _peak(values: Array, at: int) -> float:
    """Place of the peak of the parabola through three values around ``at``, relative to it."""
    if not 0 < at < len(values) - 1 or not np.isfinite(values[at - 1 : at + 2]).all():
        return 0.0
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2 * middle + right
    return float(0.5 * (left - right) / bend) if bend < 0 else 0.0


def suspicious(rows: Rows) -> Mask:
    """Which recorded labels contradict the motion; none where label and motion are not related."""
    motion, _ = motion_of(rows)
    label = rows["road_wheel_rad"]
    usable = np.isfinite(label) & np.isfinite(motion) & (rows["split"] != "none")
    usable &= rows["camera_left_m"] == 0.0
    none = np.zeros(len(rows), bool)
    if usable.sum() < LEAST_FRAMES:
        return none
    motion = np.nan_to_num(np.clip(motion, *np.nanpercentile(motion, (1, 99))))
    seen = _window(motion, rows["stretch"])[usable]
    wanted = label[usable]
    fold = (np.arange(len(wanted)) * BLOCKS // len(wanted)) % FOLDS
    residual = np.abs(wanted - _cross_validate(seen, wanted, fold))
    spread = 1.4826 * float(np.median(residual))
    explained = 1.0 - np.mean(residual**2) / max(np.var(wanted), 1e-12)
    if explained < LEAST_CORRELATION**2 or spread == 0.0:
        return none
    none[usable] = residual > SUSPICIOUS * spread
    return none


def _window(motion: Column, stretch: NDArray[np.int32]) -> Array:
    """The motion around each row, 0 outside its stretch, (n, BEFORE + AFTER + 1)."""
    at = np.arange(len(motion))[:, None] + np.arange(-BEFORE, AFTER + 1)
    inside = np.clip(at, 0, len(motion) - 1)
    same = (at == inside) & (stretch[inside] == stretch[:, None])
    return np.where(same, motion[inside], 0.0)


def _cross_validate(seen: Array, wanted: Column, fold: NDArray[np.intp]) -> Column:
    """The prediction of each row by a ridge regression over the other folds."""
    found = np.zeros(len(wanted))
    for number in range(FOLDS):
        others = fold != number
        mean, scale = seen[others].mean(axis=0), seen[others].std(axis=0) + 1e-12
        x, offset = (seen[others] - mean) / scale, wanted[others].mean()
        gram = x.T @ x + RIDGE * len(x) * np.eye(x.shape[1])
        weights = np.linalg.solve(gram, x.T @ (wanted[others] - offset))
        found[~others] = (seen[~others] - mean) / scale @ weights + offset
    return found
