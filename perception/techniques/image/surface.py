"""Similarity of each pixel to the road ahead of the vehicle (inventory B13, B15, B16)."""

import math
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.lane.detection.surface import SurfaceSettings, road_likelihood, surface_bins
from perception.techniques.image.colour import grey
from perception.techniques.image.picture import FeatureKind, Features, GroundView, sight_share
from trepid.types import Floats, Image, Mask, Positive, Share

PATCH_M = 6.0  # length of the patch, from the nearest visible road
PATCH_HALF_M = 0.8  # half its width: the road between the wheels
REST_HALF_M = 3.0  # farther aside lies mostly no road
LEAST_GREY = 3.0  # sensor noise
REST_PX = 100


def patch(view: GroundView, *, half_width_m: float = PATCH_HALF_M, length_m: float = PATCH_M) -> Mask:
    """Certain road: ``length_m`` from the nearest row, ``half_width_m`` to both sides of the vehicle."""
    ahead = view.ahead_m[view.ahead_m > 0]
    mask = np.zeros((view.height_px, view.width_px), np.uint8)
    if not len(ahead):
        return mask > 0
    near, far = float(ahead.min()), float(ahead.min()) + length_m
    corners = [(near, half_width_m), (far, half_width_m), (far, -half_width_m), (near, -half_width_m)]
    cv2.fillConvexPoly(mask, np.round(view.pixels(corners)).astype(np.int32), 1)
    return mask > 0


def brightness(image: Image, view: GroundView, *, spread: Positive = 3.0) -> Features:
    """Road where the grey level is within ``spread`` deviations of that of the patch ahead (B13, B15).

    |I − median| < k·max(1.48·MAD, 3), both of the patch; response 1 or 0. Source: R 1.2, [74]. Limit: edges of the
    same brightness; shadows on the road.
    """
    plain = cv2.GaussianBlur(grey(image, view), (0, 0), 1.5)
    middle, deviation = _of_patch(np.asarray(plain, np.uint8), view)
    alike = np.abs(plain - np.float32(middle)) < spread * max(deviation, LEAST_GREY)
    return _region(np.asarray(alike, np.float32), view)


def patch_colour(
    image: Image,
    view: GroundView,
    *,
    chroma_limit: Positive = 2.5,
    light_limit: Positive = 1.5,
    light_weight: Share = 0.6,
    smoothing: Positive = 20.0,
    length_m: Positive | None = None,
) -> Features:
    """Probability of road by the colour of the patch ahead against that of the sides of the picture (B16).

    ``length_m``: of the patch; PATCH_M, shorter for a low camera, by default.

    1/(1 + exp(−Λ)) of the log-likelihood ratio Λ of smoothed CIELAB histograms
    (:mod:`perception.lane.detection.surface`). Source: R 1.3. Limit: verges of the colour of the road.
    """
    inside = patch(view, length_m=length_m or PATCH_M * sight_share(view.camera))
    outside = np.isfinite(view.pixel_m)[:, None] & ~patch(view, half_width_m=REST_HALF_M, length_m=60.0)
    if image.ndim == 2 or not inside.any() or np.count_nonzero(outside) < REST_PX:
        return Features(np.zeros(image.shape[:2], np.float32), FeatureKind.REGION)
    settings = SurfaceSettings(
        chroma_limit=chroma_limit, light_limit=light_limit, light_weight=light_weight, smoothing=smoothing
    )
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.2), np.uint8)
    ratio = road_likelihood(surface_bins(smooth), inside, outside, settings)
    return _region(np.asarray(1 / (1 + np.exp(-ratio)), np.float32), view)


def texture(image: Image, view: GroundView, *, window_px: Annotated[int, Field(ge=3, le=31)] = 9) -> Features:
    """Road where the local contrast is that of the patch ahead: 1, falling with the deviation (B13).

    Local contrast t = ln(1 + √(mean of the squared Laplacian in a square)); response exp(−½·((t − t₀)/σ)²) for
    rougher places, 1 for smoother ones. Source: R 1.2. Limit: verges as smooth as the road, such as snow; paint.
    """
    curvature = cv2.Laplacian(grey(image, view), cv2.CV_32F)
    rough = np.log1p(np.sqrt(cv2.boxFilter(curvature * curvature, -1, (window_px, window_px))))
    middle, deviation = _of_patch(np.asarray(rough, np.float32), view)
    beyond = np.maximum(rough - middle, 0) / (2 * max(deviation, 0.15))
    return _region(np.asarray(np.exp(-0.5 * beyond**2), np.float32), view)


def _of_patch(values: Image | Floats, view: GroundView) -> tuple[float, float]:
    """Median and deviation, 1.48·MAD, of ``values`` in the patch ahead; −∞ and 0 when no row shows the road."""
    inside = values[patch(view)]
    if not len(inside):
        return -math.inf, 0.0
    middle = float(np.median(inside))
    return middle, 1.48 * float(np.median(np.abs(inside - middle)))


def _region(response: Floats, view: GroundView) -> Features:
    response[~np.isfinite(view.pixel_m)] = 0  # sky
    return Features(response, FeatureKind.REGION)
