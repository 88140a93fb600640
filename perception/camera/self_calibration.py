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
WITH_ABOVE = -1.0, 0.8  # rows where the lines of a road may meet if the image need not show the horizon
MEET, CLEARLY = 0.4, 0.2  # share of the segments that meet above the image; more than meet inside by this


class VanishingPoint(NamedTuple):
    """The point where the lines of the road meet, as shares of the image size."""

    x: float
    y: float


def calibrate_by_images(images: Sequence[NDArray[np.uint8]], settings: SelfCalibrationSettings) -> Camera:
    """A typical windscreen camera for ``images`` of equal size, whose horizon is the median of theirs."""
    horizon = float(np.median([vanishing_point(image, settings).y for image in images]))
    height_px, width_px = images[0].shape[:2]
    return typical_camera(width_px, height_px, horizon, settings)


def typical_camera(
    width_px: int, height_px: int, horizon: float, settings: SelfCalibrationSettings
) -> Camera:
    """A typical windscreen camera with the horizon of a flat road at the share ``horizon`` of the image height.

    A flat road straight ahead vanishes at v = cy − f·tan(pitch), so pitch = atan((cy − v)/f). In an image much
    higher than wide this is beyond the bounds of a :class:`Camera`, and the pitch is the steepest one.
    """
    height_px, width_px = max(height_px, MIN_CAMERA_PX), max(width_px, MIN_CAMERA_PX)
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
    """The point to which most line segments of ``image`` point, with a Gaussian prior on its place."""
    if min(image.shape[:2]) < MIN_IMAGE_PX:
        return VanishingPoint(x=0.5, y=settings.horizon_share)
    votes = Votes.of(image, settings)
    score = votes.score - settings.prior_weight * _surprise(votes.y, settings)[:, None]
    best_y, best_x = np.unravel_index(int(np.argmax(score)), score.shape)
    return VanishingPoint(x=float(votes.x[best_x]), y=float(votes.y[best_y]))


class Horizon:
    """The horizon of a drive: the row to which the segments of all its frames point.

    A frame may show no road, or a bend. The score of a row is that of its best place in each frame, because the
    vehicle turns, and its mean over the frames is weighted by the length of their segments; old ones fade, because
    a load or a mount may change. The prior counts as one frame.

    The search for segments costs more than the rest of the finder, and the mean hardly moves once it is that of
    ``horizon_known`` frames: from then on only every ``horizon_every``-th frame counts.
    """

    def __init__(self, settings: SelfCalibrationSettings) -> None:
        self._settings = settings
        self._rows = np.empty(0)  # shares of the image height
        self._sum, self._length_px, self._frames = np.zeros(1), 0.0, 0.0
        self._seen, self._found = 0, settings.horizon_share  # frames, and the horizon in them

    def update(self, image: NDArray[np.uint8]) -> float:
        """The horizon with ``image``, of the same size as those before, as a share of its height."""
        settings = self._settings
        due = self._seen < settings.horizon_known or self._seen % settings.horizon_every == 0
        self._seen += 1
        if due and min(image.shape[:2]) >= MIN_IMAGE_PX:
            votes, keep = Votes.of(image, settings), settings.horizon_keep
            self._rows = votes.y
            self._sum = keep * self._sum + votes.length_px * votes.score.max(axis=1)
            self._length_px = keep * self._length_px + votes.length_px
            self._frames = keep * self._frames + 1
            prior = settings.prior_weight * _surprise(self._rows, settings)
            score = self._sum / max(self._length_px, 1.0) - prior / self._frames
            self._found = float(self._rows[int(np.argmax(score))])
        return self._found


def meet_above(image: NDArray[np.uint8], settings: SelfCalibrationSettings) -> bool:
    """Whether the lines of the road meet above the upper edge of ``image``, clearly more of them than inside."""
    if min(image.shape[:2]) < MIN_IMAGE_PX:
        return False
    votes = Votes.of(image, settings, WITH_ABOVE)
    best, above = votes.score.max(axis=1), votes.y < 0
    return bool(best[above].max() > max(MEET, best[~above].max() + CLEARLY))


class LooksDown:
    """Whether the camera of a drive looks so far down that the horizon is above its images."""

    def __init__(self, settings: SelfCalibrationSettings) -> None:
        self._settings = settings
        self._above, self._frames = 0, 0

    def update(self, image: NDArray[np.uint8]) -> bool:
        """The same with ``image``: in most of the first ``CALIBRATION_FRAMES`` the lines meet above it."""
        if self._frames < CALIBRATION_FRAMES:
            self._frames += 1
            self._above += meet_above(image, self._settings)
        return 2 * self._above > self._frames


class Votes(NamedTuple):
    """The votes of the segments of an image for each place of a grid."""

    x: Array  # of the grid, shares of the width
    y: Array  # ..., shares of the height
    score: Array  # share of the length that points to each place, less the prior of x; shape (len(y), len(x))
    length_px: float  # of all segments

    @classmethod
    def of(
        cls,
        image: NDArray[np.uint8],
        settings: SelfCalibrationSettings,
        between: tuple[float, float] = (0.2, 0.8),
    ) -> "Votes":
        """Each segment votes with its length for every place above it within a few degrees of its direction.

        The places are ``between`` two rows, shares of the height.
        """
        grey = small_grey(image)
        rows, columns = grey.shape
        found = segments(grey)
        slanted = (np.abs(found.direction[:, 1]) > MIN_RISE) & (found.length_px > settings.min_segment_px)
        found = found.part(slanted)
        y = np.arange(between[0] * rows, between[1] * rows, settings.grid_step_px)
        x = np.arange(0.2 * columns, 0.8 * columns, settings.grid_step_px)
        aside = ((x / columns - 0.5) / settings.centre_sigma) ** 2 / 2
        score = np.broadcast_to(-settings.prior_weight * aside, (len(y), len(x)))
        if slanted.any():
            score = score + _shares(x, y, found, settings.angle_sigma_rad)
        length_px = float(np.minimum(found.length_px, MAX_LENGTH_PX).sum())
        return cls(x / columns, y / rows, score, length_px)


def _surprise(y: Array, settings: SelfCalibrationSettings) -> Array:
    """Half the squared standard deviations of a horizon at each row, a share of the image height."""
    return np.asarray(((y - settings.horizon_share) / settings.horizon_sigma) ** 2 / 2)


def _shares(x: Array, y: Array, found: Segments, sigma_rad: float) -> Array:
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
