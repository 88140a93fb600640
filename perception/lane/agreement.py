"""How far lanes found under different assumptions are the same lane in the image."""

from collections.abc import Sequence

import cv2
import numpy as np

from perception.lane.detection.evenness import columns
from trepid.messages import SteeringEstimate
from trepid.types import Array, Image

ROWS = 32  # of the lower half of the image
OTHER_LANE, SAME_LANE = 0.4, 0.85  # overlap (IoU) of half a lane beside; of a lane with ragged edges
NOISE_GREY, SHIFT_PX = 2, 1.0


def lane_columns(estimate: SteeringEstimate, height_px: int, width_px: int) -> Array:
    """Columns of both boundaries inside the image at rows of its lower half, shape (2, ROWS); 0 where not known."""
    rows = np.linspace(height_px / 2, height_px - 1, ROWS)
    paths = estimate.left_boundary_px, estimate.right_boundary_px
    found = np.clip(np.stack([columns(path, rows) for path in paths]), 0, width_px)
    return np.where(np.isnan(found).any(axis=0), 0.0, found)


def overlap(one: Array, other: Array) -> float:
    """Intersection over union of the areas of two lanes, given as :func:`lane_columns`; 0 without a lane."""
    shared = np.maximum(np.minimum(one[1], other[1]) - np.maximum(one[0], other[0]), 0.0).sum()
    union = (one[1] - one[0]).sum() + (other[1] - other[0]).sum() - shared
    return float(shared / union) if union > 0 else 0.0


def agreement(one: Array, other: Array) -> float:
    """1 for the same lane, 0 for another one, by their overlap: linear from ``OTHER_LANE`` to ``SAME_LANE``."""
    return min(max((overlap(one, other) - OTHER_LANE) / (SAME_LANE - OTHER_LANE), 0.0), 1.0)


def apart(one: SteeringEstimate, other: SteeringEstimate, height_px: int) -> float | None:
    """Distance of the boundaries of two lanes in widths of the ``other``: median over the rows of the lower half.

    The greater one of both sides; boundaries beside the image count as well. In rows in which the left boundary of
    the ``other`` is not left of its right one, it has no lane: the distance is infinite. None where no row has all
    four.
    """
    rows = np.linspace(height_px / 2, height_px - 1, ROWS)
    lanes = [
        np.stack([columns(path, rows) for path in (lane.left_boundary_px, lane.right_boundary_px)])
        for lane in (one, other)
    ]
    width_px = lanes[1][1] - lanes[1][0]
    off = np.full_like(lanes[0], np.inf)
    np.divide(np.abs(lanes[0] - lanes[1]), width_px, out=off, where=~(width_px <= 0.0))
    known = ~np.isnan(lanes).any(axis=(0, 1))
    return float(np.median(off[:, known], axis=1).max()) if known.any() else None


def marginal(probability: Array, weight: Array, lanes: Sequence[Array]) -> Array:
    """P_j = Σ_i w_i·p_i·a_ij / Σ_i w_i with the agreement a_ij of the lanes i and j; shape (n,)."""
    agreed = np.array([[agreement(one, other) for other in lanes] for one in lanes])
    return np.asarray(agreed @ (weight * probability) / weight.sum())


def with_noise(image: Image) -> Image:
    """``image`` with a fixed noise of up to ±``NOISE_GREY`` grey levels."""
    shape = image.shape[:2] if image.ndim == 2 else (*image.shape[:2], 1)
    noise = np.random.default_rng(1).integers(-NOISE_GREY, NOISE_GREY + 1, shape)
    return np.clip(image.astype(np.int16) + noise, 0, 255).astype(np.uint8)


def shift_image(image: Image) -> Image:
    """``image`` moved right and down by ``SHIFT_PX``."""
    move = np.array([[1.0, 0.0, SHIFT_PX], [0.0, 1.0, SHIFT_PX]])
    size = image.shape[1], image.shape[0]
    return cv2.warpAffine(image, move, size, borderMode=cv2.BORDER_REPLICATE).astype(np.uint8, copy=False)
