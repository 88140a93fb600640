"""A camera nobody described: a typical one, turned so that its horizon passes through the vanishing point."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.camera.image_statistics import grey_image
from trepid.camera import Camera
from trepid.config import Settings
from trepid.types import Array, Positive, Share

MIN_CAMERA_PX = 16  # the smallest image that a Camera describes
MIN_IMAGE_PX = 32  # the smallest image with lines in it


class SelfCalibrationSettings(Settings):
    """Section ``self_calibration`` of ``config/perception.yaml``."""

    focal_per_width: Positive
    height_m: Positive
    ahead_of_rear_axle_m: float
    horizon_share: Share
    horizon_sigma: Positive
    centre_sigma: Positive
    min_segment_px: Positive
    angle_sigma_rad: Positive
    prior_weight: Positive
    grid_step_px: Annotated[int, Field(ge=1)]


@dataclass(frozen=True)
class VanishingPoint:
    """Where the lines of the road meet, as shares of the image size, and the evidence for it."""

    x: float
    y: float
    votes: float  # share of the total length of line segments that point there


def assumed_camera(
    width_px: int, height_px: int, horizon: float, settings: SelfCalibrationSettings
) -> Camera:
    """A typical windscreen camera whose horizon lies at the share ``horizon`` of the image height.

    A flat road straight ahead vanishes at v = cy − f·tan(pitch), so pitch = atan((cy − v)/f).
    """
    focal_px = settings.focal_per_width * width_px
    centre_y_px = (height_px - 1) / 2
    return Camera(
        width_px=width_px,
        height_px=height_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width_px - 1) / 2,
        cy_px=centre_y_px,
        x_m=settings.ahead_of_rear_axle_m,
        y_m=0.0,
        height_m=settings.height_m,
        pitch_down_rad=math.atan((centre_y_px - horizon * height_px) / focal_px),
        yaw_rad=0.0,
    )


def self_calibrated(images: Sequence[NDArray[np.uint8]], settings: SelfCalibrationSettings) -> Camera:
    """The camera of ``images`` (equal in size): typical, with the median horizon of their vanishing points."""
    height_px, width_px = (max(size, MIN_CAMERA_PX) for size in images[0].shape[:2])
    horizon = float(np.median([vanishing_point(image, settings).y for image in images]))
    return assumed_camera(width_px, height_px, horizon, settings)


def vanishing_point(image: NDArray[np.uint8], settings: SelfCalibrationSettings) -> VanishingPoint:
    """The point that most line segments of ``image`` point to, with a prior on where cameras look.

    Segments are those of Grompone von Gioi et al., LSD: a Line Segment Detector, IPOL 2012. Each votes with its
    length for every point of a grid that lies above it within a few degrees of its direction.
    """
    if min(image.shape[:2]) < MIN_IMAGE_PX:
        return VanishingPoint(x=0.5, y=settings.horizon_share, votes=0.0)
    grey = grey_image(image)
    rows, columns = grey.shape
    middle, direction, length = _segments(grey, settings)
    step = settings.grid_step_px
    y = np.arange(0.2 * rows, 0.8 * rows, step)
    x = np.arange(0.2 * columns, 0.8 * columns, step)
    prior = (
        ((y[:, None] / rows - settings.horizon_share) / settings.horizon_sigma) ** 2
        + ((x[None, :] / columns - 0.5) / settings.centre_sigma) ** 2
    ) / 2
    score = -settings.prior_weight * prior
    if len(length):
        score = score + _votes(x, y, middle, direction, length, settings.angle_sigma_rad)
    best_y, best_x = np.unravel_index(int(np.argmax(score)), score.shape)
    votes = float(score[best_y, best_x] + settings.prior_weight * prior[best_y, best_x])
    return VanishingPoint(x=float(x[best_x] / columns), y=float(y[best_y] / rows), votes=votes)


def _segments(grey: NDArray[np.uint8], settings: SelfCalibrationSettings) -> tuple[Array, Array, Array]:
    """Middles (n, 2), unit directions (n, 2) pointing up, and lengths (n,) of the slanted segments."""
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    if found is None:
        return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    ends = np.asarray(found, float).reshape(-1, 4)
    start, end = ends[:, :2], ends[:, 2:]
    span = end - start
    span *= np.where(span[:, 1] > 0, -1.0, 1.0)[:, None]
    length = np.maximum(np.hypot(span[:, 0], span[:, 1]), 1e-9)
    direction = span / length[:, None]
    slanted = (np.abs(direction[:, 1]) > 0.15) & (length > settings.min_segment_px)
    return ((start + end) / 2)[slanted], direction[slanted], length[slanted]


def _votes(x: Array, y: Array, middle: Array, direction: Array, length: Array, sigma_rad: float) -> Array:
    """Share of the length that points to each place of the grid, shape (len(y), len(x))."""
    to_x = x[None, :, None] - middle[:, 0]
    to_y = y[:, None, None] - middle[:, 1]
    distance = np.sqrt(to_x**2 + to_y**2) + 1e-9
    sine = (to_x * direction[:, 1] - to_y * direction[:, 0]) / distance
    towards = to_x * direction[:, 0] + to_y * direction[:, 1] > 0
    weight = np.minimum(length, 40.0) / np.minimum(length, 40.0).sum()
    return np.sum(weight * towards * np.exp(-0.5 * (sine / sigma_rad) ** 2), axis=2)
