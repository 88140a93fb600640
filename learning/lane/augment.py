"""Augmentation of training images, and images without a road. All randomness comes from a given Generator."""

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from learning.pixels import add_noise, as_pixels, blemish, relight, shade
from perception.net.canonical import MIRRORED, lane_of_row, row_of_lane, scale_lane
from trepid.car.camera import Camera
from trepid.config import Settings
from trepid.types import Floats, Image, NonNegative, Share

LEAST_BLUR_PX = 0.3  # σ


class Augmentation(Settings):
    """Section ``augmentation`` of ``config/train.yaml``."""

    flip: Share
    height: NonNegative
    shift_px: NonNegative
    roll_rad: NonNegative
    gain: Annotated[float, Field(ge=1)]
    gamma: Annotated[float, Field(ge=1)]
    colour: NonNegative
    offset_grey: NonNegative
    shadows: Share
    blur: Share
    blur_px: NonNegative
    noise: Share
    noise_grey: NonNegative
    erase: Share
    erase_size: Share
    border: Share
    border_size: Share
    bonnet: Share
    bonnet_size: Share
    coarse: Share
    coarse_scale: Share
    coded: Share
    coded_quality: Annotated[float, Field(ge=0, le=100)]


class Augmenter:
    """Augmentation that changes the label with the image."""

    def __init__(self, settings: Augmentation, canonical: Camera, *, lookahead_m: float) -> None:
        """``canonical``: the camera of all images; ``lookahead_m``: look-ahead of the fourth number of a lane."""
        self._settings = settings
        self._camera = canonical
        self._lookahead_m = lookahead_m

    def __call__(self, image: Image, lane: Floats, rng: np.random.Generator) -> tuple[Image, Floats]:
        """An augmented image and its lane, (5,). A mirrored image has the mirrored lane."""
        settings = self._settings
        if rng.random() < settings.flip:
            image, lane = as_pixels(cv2.flip(image, 1)), MIRRORED * lane
        raised = float(np.exp(settings.height * rng.normal()))
        image = self._move_camera(image, raised, rng)
        lane = self.lane_from(lane, raised)
        if rng.random() < settings.shadows:
            image = shade(image, rng)
        image = relight(image, rng, settings)
        # without a draw where they are off: the other changes stay the same
        if settings.bonnet and rng.random() < settings.bonnet:
            image = _above_bonnet(image, settings.bonnet_size, rng)
        if settings.coarse and rng.random() < settings.coarse:
            image = _coarse(image, settings.coarse_scale, rng)
        image = blemish(image, rng, settings, least_blur_px=LEAST_BLUR_PX)
        if settings.coded and rng.random() < settings.coded:
            image = _code_jpeg(image, int(rng.uniform(settings.coded_quality, 100)))
        if rng.random() < settings.border:
            image = _narrow(image, settings.border_size, rng)
        return image, lane

    def lane_from(self, lane: Floats, raised: float) -> Floats:
        """The label for an image taken from ``raised`` times the canonical height.

        The inverse of :meth:`perception.net.canonical.CanonicalView.lane` for a camera at that height.
        """
        ahead_m, left_m = (1 - raised) * self._camera.x_m, (1 - raised) * self._camera.y_m
        course, width_m = lane_of_row(lane, self._lookahead_m)
        seen = scale_lane(course.in_frame_at(ahead_m, left_m), 1 / raised)
        return row_of_lane(seen, width_m / raised, self._lookahead_m)

    def pixel_from_pixel(self, raised: float) -> NDArray[np.float64]:
        """Homography of the ground from the canonical height to ``raised`` times it: K·R·diag(1, 1, k)·Rᵀ·K⁻¹."""
        project = self._camera.intrinsics @ self._camera.optical_from_vehicle
        return project @ np.diag([1, 1, raised]) @ np.linalg.inv(project)

    def _move_camera(self, image: Image, raised: float, rng: np.random.Generator) -> Image:
        """Another camera height; then roll and a shift along the columns, as of a rolling and pitching body."""
        height, width = image.shape[:2]
        roll_deg = float(np.rad2deg(self._settings.roll_rad * rng.normal()))
        turn = np.eye(3)
        turn[:2] = cv2.getRotationMatrix2D((width / 2, height / 2), roll_deg, 1.0)
        turn[1, 2] += self._settings.shift_px * rng.normal()
        matrix = turn @ self.pixel_from_pixel(raised)
        return as_pixels(cv2.warpPerspective(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE))


def _narrow(image: Image, size: float, rng: np.random.Generator) -> Image:
    """Black borders, as of a camera with a narrower field of view."""
    height, width = image.shape[:2]
    left, right = (rng.uniform(0, size, 2) * width).astype(int)
    bottom = int(rng.uniform(0, size) * height)
    narrow = np.zeros_like(image)
    narrow[: height - bottom, left : width - right] = image[: height - bottom, left : width - right]
    return narrow


def _above_bonnet(image: Image, size: float, rng: np.random.Generator) -> Image:
    """The bonnet of the own car over the lowest rows: one colour, other towards the sides, an arched rim."""
    height, width = image.shape[:2]
    across = np.linspace(-1, 1, width)
    middle, arch = rng.uniform(0.2, 1) * size * height, rng.uniform(0, 0.6)
    rim = height - middle * (1 - arch * across**2)
    cover = np.clip(np.arange(height)[:, None] - rim + 0.5, 0, 1)[..., None]
    shine = 1 + rng.uniform(-0.5, 0.5) * across + rng.uniform(-0.5, 0.5) * across**2
    colour = (rng.uniform(10, 220) + rng.normal(0, 20, 3)) * shine[:, None]
    return np.clip(image + cover * (colour - image), 0, 255).astype(np.uint8)


def _coarse(image: Image, scale: float, rng: np.random.Generator) -> Image:
    """The image of a camera with fewer pixels, at least ``scale`` times as many on a side."""
    share = rng.uniform(scale, 1)
    size = (max(1, round(share * image.shape[1])), max(1, round(share * image.shape[0])))
    return _stretch(as_pixels(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), image)


def _code_jpeg(image: Image, quality: int) -> Image:
    """The image after coding as JPEG."""
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)


def nonsense(road: Image, rng: np.random.Generator) -> Image:
    """An image of the size of ``road`` without a road: plain, shaded, noise, clouds, shapes, or a shuffled road."""
    kinds = (_plain, _gradient, _noise, _clouds, _shapes, _upside_down, _shuffle, _sky_only, _flat_road)
    image = kinds[rng.integers(len(kinds))](road, rng)
    if rng.random() < 0.5:
        image = add_noise(image, 12 * rng.random(), rng)
    return image


def _plain(road: Image, rng: np.random.Generator) -> Image:
    grey = (0, 255, int(rng.integers(0, 256)))[rng.integers(3)]
    colour = rng.integers(0, 256, 3) if rng.random() < 0.5 else np.full(3, grey)
    return np.broadcast_to(colour.astype(np.uint8), road.shape).copy()


def _gradient(road: Image, rng: np.random.Generator) -> Image:
    corners = rng.integers(0, 256, (2, 2, 3)).astype(np.uint8)
    return _stretch(corners, road)


def _noise(road: Image, rng: np.random.Generator) -> Image:
    centre, spread = rng.uniform(0, 255), rng.uniform(5, 120)
    noise = rng.normal(centre, spread, (*road.shape[:2], rng.choice((1, 3))))
    return np.broadcast_to(np.clip(noise, 0, 255), road.shape).astype(np.uint8)


def _clouds(road: Image, rng: np.random.Generator) -> Image:
    rows, columns = rng.integers(3, 24), rng.integers(3, 60)
    return _stretch(rng.integers(0, 256, (rows, columns, 3)).astype(np.uint8), road)


def _shapes(road: Image, rng: np.random.Generator) -> Image:
    """Discs, lines and triangles in random colours."""
    image = _gradient(road, rng)
    height, width = road.shape[:2]
    for _ in range(rng.integers(3, 25)):
        points = rng.uniform((0, 0), (width, height), (3, 2)).astype(np.int32)
        colour = [int(value) for value in rng.integers(0, 256, 3)]
        kind = rng.integers(3)
        if kind == 0:
            cv2.circle(image, points[0].tolist(), int(rng.integers(2, 25)), colour, -1)
        elif kind == 1:
            cv2.line(image, points[0].tolist(), points[1].tolist(), colour, int(rng.integers(1, 6)))
        else:
            cv2.fillPoly(image, [points], colour)
    return image


def _upside_down(road: Image, rng: np.random.Generator) -> Image:
    return np.ascontiguousarray(road[::-1])


def _shuffle(road: Image, rng: np.random.Generator) -> Image:
    """The road cut into strips and tiles in another order."""
    columns = np.array_split(np.arange(road.shape[1]), rng.integers(6, 20))
    rows = np.array_split(np.arange(road.shape[0]), rng.integers(3, 8))
    rng.shuffle(columns)
    rng.shuffle(rows)
    return road[np.concatenate(rows)[:, None], np.concatenate(columns)]


def _sky_only(road: Image, rng: np.random.Generator) -> Image:
    """The topmost rows over the whole image, as of a camera that points up."""
    return _stretch(np.ascontiguousarray(road[: max(2, road.shape[0] // 12)]), road)


def _flat_road(road: Image, rng: np.random.Generator) -> Image:
    """A patch of the ground over the whole image, as of a camera that points down or is covered."""
    height, width = road.shape[:2]
    top, left = rng.integers(height // 2, height - 6), rng.integers(0, width - 12)
    return _stretch(np.ascontiguousarray(road[top : top + 6, left : left + 12]), road)


def _stretch(image: Image, like: Image) -> Image:
    return as_pixels(cv2.resize(image, (like.shape[1], like.shape[0]), interpolation=cv2.INTER_CUBIC))
