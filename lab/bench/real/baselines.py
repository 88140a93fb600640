"""Answers that see nothing: a trapezoid fitted to labels of other sequences, and angles of other times.

An estimator that is no better than these has not used the image.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from lab.bench.real.look import GRID_PX
from trepid.types import Array, Mask

Row = dict[str, Any]
BOUNDS = ((0.2, 0.7), (0.2, 0.7), (0.3, 0.8), (-0.5, 0.5), (0.5, 1.5))
"""Of top row, left and right end there, left and right end at the bottom, in shares of the image."""
FIT_FRAMES = 40
BEFORE_S, AROUND_S = 0.2, 0.5


def masks_of(rows: Sequence[Row], field: str) -> Mask:
    """The masks ``label`` or ``known`` of ``rows``, shape (n, height, width) of the grid."""
    width, height = GRID_PX
    bits = [np.frombuffer(bytes.fromhex(row[field]), np.uint8) for row in rows]
    return np.array([np.unpackbits(one)[: width * height].reshape(height, width) for one in bits], bool)


def trapezoid(shape: Sequence[float]) -> Mask:
    """The pixels of the grid within a trapezoid with the numbers of BOUNDS."""
    top, left_top, right_top, left, right = shape
    width, height = GRID_PX
    rows, at = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    down = ((rows - top) / max(1 - top, 1e-3))[:, None]
    inside = (at >= left_top + down * (left - left_top)) & (at <= right_top + down * (right - right_top))
    return np.asarray(inside & (down >= 0))


def overlap(mask: Mask, labels: Mask, known: Mask) -> Array:
    """IoU of one mask with each of n labels where these are known, shape (n,)."""
    both, either = mask & labels & known, (mask | labels) & known
    return np.asarray(both.sum(axis=(1, 2)) / np.maximum(either.sum(axis=(1, 2)), 1))


def fit_trapezoid(others: Sequence[Row]) -> Mask | None:
    """The trapezoid with the greatest mean IoU with labels of other sequences; None without any.

    Differential evolution (Storn and Price 1997), with a fixed seed.
    """
    if not others:
        return None
    chosen = others[:: max(1, len(others) // FIT_FRAMES)]
    labels, known = masks_of(chosen, "label"), masks_of(chosen, "known")
    found = differential_evolution(
        lambda shape: -float(overlap(trapezoid(shape), labels, known).mean()),
        BOUNDS,
        rng=0,
        popsize=8,
        maxiter=60,
        polish=False,
    )
    return trapezoid(found.x)


def angles(rows: Sequence[Row]) -> dict[str, Array]:
    """Wheel angles [rad] of each baseline, shape (n,).

    Straight ahead, mean of other stretches, the driver's angle of 0.2 s ago, and the mean of the driver's angles
    from 0.5 s before to 0.5 s after the frame without that of the frame: what remains of the course without pulses.
    NaN where there is none: in the first 0.2 s of a stretch, or without another stretch or frame.
    """
    truth = np.array([row["steering_rad"] for row in rows], float)
    drives, t_s = np.array([row["drive"] for row in rows]), np.array([row["t_s"] for row in rows])
    mean, before, around = (np.full(len(rows), np.nan) for _ in range(3))
    for drive in dict.fromkeys(drives.tolist()):
        mine = np.flatnonzero(drives == drive)
        if len(mine) < len(rows):
            mean[mine] = truth[drives != drive].mean()
        index = np.searchsorted(t_s[mine], t_s[mine] - BEFORE_S, side="right") - 1
        past = index >= 0
        before[mine[past]] = truth[mine[index[past]]]
        near = np.abs(t_s[mine][:, None] - t_s[mine]) < AROUND_S + 1e-6
        np.fill_diagonal(near, False)
        some = near.any(axis=1)
        around[mine[some]] = near[some] @ truth[mine] / near[some].sum(axis=1)
    return {"straight": np.zeros(len(rows)), "mean": mean, "previous_200ms": before, "around_500ms": around}
