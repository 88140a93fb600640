"""The direction of the texture at every pixel, and the vanishing point with most votes of it (R [73]; S17)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.techniques.boundaries.evidence import both
from perception.techniques.boundaries.lines import NEAR_M
from perception.techniques.image.colour import grey
from perception.techniques.image.picture import (
    Boundaries,
    Boundary,
    Evidence,
    FeatureKind,
    Features,
    GroundView,
)
from trepid.types import Array, Floats, Image, NonNegative, OpenShare, Positive

ORIENTATIONS_RAD = np.deg2rad([0.0, 45.0, 90.0, 135.0])
EVEN_GREY = 2.0  # amplitude of a filter on sensor noise: no direction
MOST_VOTERS = 4000
STEP_M, NEAREST_SIDE_M = 0.1, 0.4  # between tested lines; least distance of an edge
SHALLOW = 0.25  # sine; perspective flattens the grain of any ground, so flat directions show no road
EVIDENCE_M = 0.4  # across a boundary


def gabor(
    image: Image, view: GroundView, *, wavelength_px: Positive = 12.0, least: NonNegative = 0.35
) -> Features:
    """Direction of the texture by four Gabor filters; the response is its consistency.

    Energies E_k = |I ∗ g_k|² of the complex filters at θ_k = 0, 45, 90, 135°; direction of the stripes
    φ = ½·atan2(Σ E_k·sin 2θ_k, Σ E_k·cos 2θ_k), response |Σ E_k·e^{2iθ_k}|/Σ E_k where that is above ``least``.
    Source: Kong, Audibert, Ponce, CVPR 2009 (36 filters there); four and their joint direction: Moghadam,
    Starzyk, Wijesoma, IEEE T. Image Processing 21 (2012). Limit: even pictures.
    """
    plain = np.asarray(grey(image, view), np.float32)
    size = 2 * round(wavelength_px) + 1
    east, north, total = (np.zeros(plain.shape, np.float32) for _ in range(3))
    for along_rad in ORIENTATIONS_RAD.tolist():
        energy = np.zeros(plain.shape, np.float32)
        for phase_rad in (0.0, np.pi / 2):
            energy += cv2.filter2D(plain, cv2.CV_32F, _filter(along_rad, phase_rad, wavelength_px, size)) ** 2
        east += np.float32(np.cos(2 * along_rad)) * energy
        north += np.float32(np.sin(2 * along_rad)) * energy
        total += energy
    sure = np.hypot(east, north) / np.maximum(total, EVEN_GREY**2)
    sure[~np.isfinite(view.pixel_m)] = 0  # sky
    direction = np.asarray(np.arctan2(north, east) / 2, np.float32)
    return Features(
        np.where(sure > least, sure, np.float32(0)).astype(np.float32), FeatureKind.TEXTURE, direction
    )


def _filter(along_rad: float, phase_rad: float, wavelength_px: float, size: int) -> Floats:
    """The Gabor filter of stripes along ``along_rad``, with sum 0."""
    kernel = cv2.getGaborKernel(
        (size, size), wavelength_px / 4, along_rad + np.pi / 2, wavelength_px, 1.0, phase_rad, cv2.CV_32F
    )
    kernel -= kernel.mean()
    return np.asarray(kernel / np.abs(kernel).sum(), np.float32)


def dominant_edges(
    evidence: Evidence,
    *,
    agree_rad: Positive = 0.1,
    max_heading_rad: OpenShare = 0.35,
    reach_m: Positive = 20.0,
    widest_m: Positive = 6.0,
    least: OpenShare = 0.25,
) -> Boundaries:
    """The vanishing point by soft voting, then the two straight edges to it with most texture along them.

    Pixel p votes for a point v of the horizon with its response · (1 − |∠(v − p) − φ_p|/``agree_rad``). Of all
    lines on the road with that heading, a side has the greatest share of pixels along it (the orientation
    consistency ratio), at least ``least``. Source: Kong, Audibert, Ponce, IEEE T. Image Processing 19 (2010).
    Limit: curves, which become a tangent; ruts, which look like edges.
    """
    direction_rad = evidence.features.direction_rad
    if direction_rad is None:
        return Boundaries(None, None, "no directions: gabor must be the only feature")
    slope = _heading(evidence, direction_rad, agree_rad, np.tan(max_heading_rad))
    if slope is None:
        return Boundaries(None, None, "the texture points nowhere")
    aside_m = np.arange(NEAREST_SIDE_M, widest_m, STEP_M)
    left, right = (
        _side(evidence, direction_rad, slope, sign * aside_m, agree_rad, reach_m, least)
        for sign in (1.0, -1.0)
    )
    return both(left, right, kind="edge")


def _heading(evidence: Evidence, direction_rad: Floats, agree_rad: float, steepest: float) -> float | None:
    """dy/dx of the road towards the column of the horizon with the most votes; None without a voter."""
    response = evidence.features.response
    steep = np.abs(np.sin(direction_rad)) > SHALLOW
    rows, columns = np.nonzero(np.where(steep, response, 0))
    if not len(rows):
        return None
    if len(rows) > MOST_VOTERS:
        chosen = evidence.rng.choice(len(rows), MOST_VOTERS, replace=False)
        rows, columns = rows[chosen], columns[chosen]
    slopes = np.linspace(-steepest, steepest, 121)
    far = evidence.view.pixel_from_ground @ np.stack([np.ones_like(slopes), slopes, np.zeros_like(slopes)])
    ends_px = (far[:2] / far[2]).T  # vanishing points of these slopes
    towards = np.arctan2(ends_px[None, :, 1] - rows[:, None], ends_px[None, :, 0] - columns[:, None])
    away = _between(towards, direction_rad[rows, columns][:, None])
    sure = response[rows, columns][:, None]
    votes = (sure * np.maximum(1 - away / agree_rad, 0)).sum(axis=0)
    best = int(votes.argmax())
    return float(slopes[best]) if votes[best] > 0 else None


def _side(
    evidence: Evidence,
    direction_rad: Floats,
    slope: float,
    aside_m: Array,
    agree_rad: float,
    reach_m: float,
    least: float,
) -> Boundary | None:
    """The line of this slope with most texture along it, of those ``aside_m`` to the left ``NEAR_M`` ahead."""
    view = evidence.view
    x_m = np.arange(max(view.nearest_m, 1.0), reach_m, 0.25)
    y_m = aside_m[:, None] + slope * (x_m - NEAR_M)[None]
    place = view.pixels(np.column_stack([np.tile(x_m, len(aside_m)), y_m.ravel()])).reshape(*y_m.shape, 2)
    step = np.gradient(place, axis=1)
    inside = ((place >= 0) & (place <= (view.width_px - 1, view.height_px - 1))).all(axis=2)
    columns, rows = (np.where(inside, np.rint(np.nan_to_num(place[..., i])), 0).astype(int) for i in (0, 1))
    away = _between(np.arctan2(step[..., 1], step[..., 0]), direction_rad[rows, columns])
    sure = np.where(inside & (away < agree_rad), evidence.features.response[rows, columns], 0.0)
    seen = inside.sum(axis=1)
    consistency = np.where(seen > len(x_m) / 4, sure.sum(axis=1) / np.maximum(seen, 1), 0.0)
    best = int(consistency.argmax())
    if consistency[best] < least:
        return None
    near = np.abs(aside_m - aside_m[best]) <= EVIDENCE_M
    weight = sure[near].sum(axis=1)
    middle_m = float(np.average(aside_m[near], weights=weight))
    scatter_m = float(np.sqrt(np.average((aside_m[near] - middle_m) ** 2, weights=weight)))
    there = np.asarray(inside)[best]
    covered = x_m[there]
    share = float(np.mean(sure[best][there] > 0))
    return Boundary(covered, middle_m + slope * (covered - NEAR_M), scatter_m, share)


def _between(one_rad: NDArray[np.floating], other_rad: NDArray[np.floating]) -> NDArray[np.floating]:
    """Angle between two directions without sense, 0 to π/2."""
    return np.abs((one_rad - other_rad + np.pi / 2) % np.pi - np.pi / 2)
