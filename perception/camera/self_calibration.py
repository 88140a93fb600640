"""A camera without a camera file: a typical camera with the horizon at the vanishing point of the images."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.camera.grey import small_grey
from perception.camera.road_lines import Segments, segments
from perception.camera.settings import SelfCalibrationSettings
from trepid.car.camera import PITCH_BOUND_RAD, Camera
from trepid.types import Array

CALIBRATION_FRAMES = 9  # of a clip, spread over it, that calibrate its camera
MIN_CAMERA_PX = 16  # of a Camera
MIN_IMAGE_PX = 32  # smaller images have no vanishing point
MIN_RISE = 0.15  # rise over length of a segment
MAX_LENGTH_PX = 40.0  # longer segments count as this


class VanishingPoint(NamedTuple):
    """The point where the lines of the road meet, as shares of the image size."""

    x: float
    y: float


def calibrate_by_images(images: Sequence[NDArray[np.uint8]], settings: SelfCalibrationSettings) -> Camera:
    """A typical windscreen camera for ``images`` of equal size, with the median horizon of their vanishing points.

    A flat road straight ahead vanishes at v = cy − f·tan(pitch), so pitch = atan((cy − v)/f). In an image much
    higher than wide this is beyond the bounds of a :class:`Camera`, and the pitch is the steepest one.
    """
    height_px, width_px = (max(size, MIN_CAMERA_PX) for size in images[0].shape[:2])
    horizon = float(np.median([vanishing_point(image, settings).y for image in images]))
    focal_px = settings.focal_per_width * width_px
    centre_y_px = (height_px - 1) / 2
    steepest_rad = math.nextafter(PITCH_BOUND_RAD, 0.0)
    pitch_rad = math.atan((centre_y_px - horizon * height_px) / focal_px)
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
        pitch_down_rad=max(-steepest_rad, min(steepest_rad, pitch_rad)),
        yaw_rad=0.0,
    )


def vanishing_point(image: NDArray[np.uint8], settings: SelfCalibrationSettings) -> VanishingPoint:
    """The point to which most line segments of ``image`` point, with a Gaussian prior on its place.

    Each segment votes with its length for every point of a grid that lies above it within a few degrees of
    its direction.
    """
    if min(image.shape[:2]) < MIN_IMAGE_PX:
        return VanishingPoint(x=0.5, y=settings.horizon_share)
    grey = small_grey(image)
    rows, columns = grey.shape
    found = segments(grey)
    slanted = (np.abs(found.direction[:, 1]) > MIN_RISE) & (found.length_px > settings.min_segment_px)
    found = found.part(slanted)
    step = settings.grid_step_px
    y = np.arange(0.2 * rows, 0.8 * rows, step)
    x = np.arange(0.2 * columns, 0.8 * columns, step)
    prior = (
        ((y[:, None] / rows - settings.horizon_share) / settings.horizon_sigma) ** 2
        + ((x[None, :] / columns - 0.5) / settings.centre_sigma) ** 2
    ) / 2
    score = -settings.prior_weight * prior
    if slanted.any():
        score = score + _votes(x, y, found, settings.angle_sigma_rad)
    best_y, best_x = np.unravel_index(int(np.argmax(score)), score.shape)
    return VanishingPoint(x=float(x[best_x] / columns), y=float(y[best_y] / rows))


def _votes(x: Array, y: Array, found: Segments, sigma_rad: float) -> Array:
    """Share of the length that points to each place of the grid, shape (len(y), len(x))."""
    direction = found.direction
    to_x = x[None, :, None] - found.middle_px[:, 0]
    to_y = y[:, None, None] - found.middle_px[:, 1]
    distance = np.sqrt(to_x**2 + to_y**2) + 1e-9
    sine = (to_x * direction[:, 1] - to_y * direction[:, 0]) / distance
    towards = to_x * direction[:, 0] + to_y * direction[:, 1] > 0
    weight = np.minimum(found.length_px, MAX_LENGTH_PX)
    weight /= weight.sum()
    return np.sum(weight * towards * np.exp(-0.5 * (sine / sigma_rad) ** 2), axis=2)
