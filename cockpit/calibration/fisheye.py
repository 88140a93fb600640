"""The lens of a fisheye as a camera file states it: a quotient of polynomials.

A fisheye by Kannala and Brandt (A generic camera model and calibration method for conventional, wide-angle, and
fish-eye lenses, IEEE PAMI 28(8), 2006; ``equidistant`` of ROS, ``cv2.fisheye``) shows a ray at the angle θ from the
axis r_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) focal lengths from the middle. All of Trepid sees through one lens
model, that of :class:`trepid.car.camera.Camera`; its quotient of polynomials in r = tan θ is fitted up to the
corner of the image, at most to MOST_RAD.
"""

import math
from collections.abc import Sequence

import numpy as np

from trepid.types import Array

MOST_RAD = math.radians(75.0)  # from the axis; a plane image beyond is more than 3.7 focal lengths away
FIT_PX = 0.5  # largest error of a fitted lens
ANGLES, ROUNDS = 400, 20  # of the fit


def corner_radius(intrinsics: Array, size_px: tuple[int, int]) -> float:
    """Distance of the farthest corner of an image (width, height) from the principal point [focal lengths]."""
    focal, middle = intrinsics[[0, 1], [0, 1]], intrinsics[:2, 2]
    return float(np.hypot(*(np.maximum(middle, np.array(size_px) - 1 - middle) / focal)))


def fit_quotient(coefficients: Sequence[float], corner: float) -> tuple[tuple[float, ...], float]:
    """k1 k2 0 0 k3 k4 k5 k6 of the fisheye with these four coefficients, and the largest error [focal lengths].

    Σ (r (1 + a1 s + a2 s² + a3 s³)/(1 + b1 s + b2 s² + b3 s³) − r_d)², s = r², is minimised by linear least squares
    whose weights are the denominators of the round before (Sanathanan and Koerner, IEEE TAC 8(1), 1963).
    """
    powers = 2 * np.arange(1, 5)

    def radius(angle: Array) -> Array:
        return np.asarray(angle * (1.0 + np.power.outer(angle, powers) @ np.asarray(coefficients)))

    angles = np.linspace(0.0, MOST_RAD, ANGLES + 1)[1:]
    beyond = np.flatnonzero(radius(angles) >= corner)
    angles = np.linspace(0.0, angles[beyond[0]] if len(beyond) else MOST_RAD, ANGLES + 1)[1:]
    plane, bent = np.tan(angles), radius(angles)
    if (np.diff(bent) <= 0.0).any():
        return (), math.inf  # two rays at one pixel
    # With all terms of a lens that needs few, the denominator may have a zero that the numerator cancels.
    return min((_quotient(plane, bent, terms) for terms in (3, 2, 1)), key=lambda found: found[1])


def _quotient(plane: Array, bent: Array, terms: int) -> tuple[tuple[float, ...], float]:
    """The quotient with ``terms`` in numerator and denominator for the radii ``bent`` at ``plane``, and its error.

    The error of a quotient with a zero in its denominator is infinite.
    """
    square, ratio, weight = plane**2, bent / plane, np.ones_like(plane)
    powers = np.stack([square**power for power in range(1, terms + 1)], axis=1)
    best: tuple[tuple[float, ...], float] = (), math.inf
    for _ in range(ROUNDS):
        rows = np.hstack([powers, -ratio[:, None] * powers]) * (weight * plane)[:, None]
        scale = np.linalg.norm(rows, axis=0)
        found = np.linalg.lstsq(rows / scale, (ratio - 1.0) * weight * plane, rcond=1e-14)[0] / scale
        above, below = 1.0 + powers @ found[:terms], 1.0 + powers @ found[terms:]
        error = float(np.abs(plane * above / below - bent).max())
        if below.min() > 0.0 and error < best[1]:
            k = np.zeros((2, 3))
            k[:, :terms] = found.reshape(2, terms)
            best = (*k[0, :2].tolist(), 0.0, 0.0, float(k[0, 2]), *k[1].tolist()), error
        weight = 1.0 / np.abs(below)
    return best
