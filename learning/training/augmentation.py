"""Changes of training frames, with the label where a change moves it. All randomness comes from a given Generator.

The frames of a sequence are changed alike: each gets the same random numbers. In a share ``flicker`` of the
sequences light, weather and pixels are drawn anew for each frame, so that a network with a memory learns that the
view changes not by motion alone.
"""

import math

import cv2
import numpy as np

from learning.dataset.sides import returning_rad
from learning.pixels import as_pixels, blemish, fog, rain, relight, shade, snow
from learning.training.recipe import Augmentation
from trepid.car.camera import Camera
from trepid.types import Floats, Image

LEAST_BLUR_PX = 0.2  # σ
FLICKER, PLACE, LOOK = 0, 1, 2  # streams of random numbers


class Augmenter:
    """Augmentation by a recipe; ``camera`` and ``wheelbase_m`` are those of the car, for mirror and viewpoint."""

    def __init__(self, settings: Augmentation, camera: Camera, *, wheelbase_m: float) -> None:
        self._settings = settings
        self._camera = camera
        self._wheelbase_m = wheelbase_m
        right, _, ahead = (camera.optical_from_vehicle @ (1.0, 0.0, 0.0)).tolist()
        self._straight_px = camera.cx_px + camera.fx_px * right / ahead  # far end of a straight road

    def __call__(self, images: Image, labels_rad: Floats, rng: np.random.Generator) -> tuple[Image, Floats]:
        """Changed frames (t, H, W, 3) and labels (t,) [rad]; a mirrored frame has the label −label."""
        seed = int(rng.integers(2**63))
        flickers = np.random.default_rng((seed, FLICKER)).random() < self._settings.flicker
        places = [
            self._move_camera(image, label, np.random.default_rng((seed, PLACE)))
            for image, label in zip(images, labels_rad, strict=True)
        ]
        moved, labels = zip(*places, strict=True)
        looks = [
            self._looking(image, np.random.default_rng((seed, LOOK, number if flickers else 0)))
            for number, image in enumerate(moved)
        ]
        return np.stack(looks), np.array(labels, np.float32)

    def _move_camera(self, image: Image, label_rad: float, rng: np.random.Generator) -> tuple[Image, float]:
        """Seen from another place."""
        settings = self._settings
        if rng.random() < settings.flip:
            image, label_rad = self.mirror_image(image), -label_rad
        if rng.random() < settings.viewpoint:
            left_m, turned_rad = rng.normal(0, (settings.viewpoint_m, settings.viewpoint_rad))
            image = self.view_from(image, left_m, turned_rad)
            ahead_m, wheelbase_m = settings.viewpoint_ahead_m, self._wheelbase_m
            label_rad = returning_rad(label_rad, left_m, turned_rad, ahead_m=ahead_m, wheelbase_m=wheelbase_m)
        if rng.random() < settings.shift:
            image = _shift(image, settings.shift_share, rng)
        return image, label_rad

    def _looking(self, image: Image, rng: np.random.Generator) -> Image:
        """In other weather and light, by another sensor."""
        settings = self._settings
        for share, change in (
            (settings.fog, fog),
            (settings.rain, rain),
            (settings.snow, snow),
            (settings.shadow, shade),
        ):
            if rng.random() < share:
                image = change(image, rng)
        if rng.random() < settings.brightness:
            image = relight(image, rng, settings)
        return blemish(image, rng, settings, least_blur_px=LEAST_BLUR_PX)

    def mirror_image(self, image: Image) -> Image:
        """The image of the mirrored world.

        Its axis is the column in which the camera shows the far end of a straight road, not the middle of the
        image: half a pixel of 320 is 0.15° of the heading.
        """
        height, width = image.shape[:2]
        column_px = (self._straight_px + 0.5) * width / self._camera.width_px - 0.5
        matrix = np.array([[-1.0, 0.0, 2.0 * column_px], [0.0, 1.0, 0.0]])
        return as_pixels(cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE))

    def view_from(self, image: Image, left_m: float, turned_rad: float) -> Image:
        """The flat road of ``image``, seen from ``left_m`` further left and turned by ``turned_rad`` to the left.

        The homography of the ground between the two places of the camera; what is above the horizon turns only.
        """
        height, width = image.shape[:2]
        camera = self._camera.resize(width, height)
        c, s = math.cos(turned_rad), math.sin(turned_rad)
        place = np.array([[c, -s, 0], [s, c, left_m], [0, 0, 1]])  # of the moved vehicle in the recorded one
        project = camera.pixel_from_road_matrix
        ground = project @ np.linalg.inv(place) @ np.linalg.inv(project)
        rays = camera.intrinsics @ camera.optical_from_vehicle
        yaw = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        far = rays @ yaw @ np.linalg.inv(rays)
        horizon = int(np.clip(math.ceil(camera.horizon_row_px) + 1, 0, height))
        parts = [
            cv2.warpPerspective(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)[rows]
            for matrix, rows in ((far, slice(horizon)), (ground, slice(horizon, None)))
        ]
        return as_pixels(np.concatenate(parts))


def _shift(image: Image, share: float, rng: np.random.Generator) -> Image:
    """Moved by up to ``share`` of the sides."""
    height, width = image.shape[:2]
    x_px, y_px = share * rng.uniform(-1, 1, 2) * (width, height)
    matrix = np.array([[1, 0, x_px], [0, 1, y_px]])
    return as_pixels(cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE))
