"""Sky, hills and trees, as a panorama on a cylinder around the world."""

import math
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.render.ground.noise import smooth_noise
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image

WIDTH = 1280  # columns of the panorama for a full turn
HEIGHT = 320
LAND = 64  # rows above the lower end in which hills lie
GROUND_BELOW_PX = 2.5  # distance of the first ground row from the horizon: 110 m ahead of the default camera
MIRROR_MARGIN_PX = 24  # rows by which the mirror image extends above the ground, for blurring
BELOW = 8  # rows of the panorama below the horizon
SKIES_BGR = (  # zenith, horizon
    ((205, 150, 100), (235, 225, 210)),
    ((190, 185, 180), (225, 222, 220)),
    ((225, 180, 130), (240, 235, 225)),
)


class Backdrop:
    """The panorama in the first ``rows`` rows of the image of one camera."""

    def __init__(self, camera: Camera, *, seed: int) -> None:
        self._camera = camera
        self.rows = min(max(math.ceil(camera.horizon_row_px + GROUND_BELOW_PX), 0), camera.height_px)
        panorama = _panorama(seed)
        self.horizon_bgr = panorama[HEIGHT - BELOW - 12].mean(axis=0)
        self._twice_around = cv2.cvtColor(np.hstack([panorama, panorama]), cv2.COLOR_BGR2BGRA)
        columns, v = _panorama_columns(camera, 0, self.rows)
        self._columns = columns
        self._rows = (v - camera.horizon_row_px + HEIGHT - BELOW).astype(np.float32)

    def draw(self, image: Image, yaw_rad: float) -> None:
        """Fill the rows of ``image`` (BGRA) to just below the horizon, for a vehicle heading along ``yaw_rad``."""
        if self.rows:
            image[: self.rows] = self._ahead(self._columns, self._rows, yaw_rad)

    def draw_from(self, image: Image, yaw_rad: float, horizon_row: float | Array) -> None:
        """Fill ``image`` (BGRA), the first rows of the camera's, for a horizon in ``horizon_row``."""
        rows = np.arange(len(image), dtype=np.float32)[:, None]
        rows = rows + np.asarray(HEIGHT - BELOW - horizon_row, np.float32)
        rows = np.clip(rows, 0, HEIGHT - 1)  # OpenCV reads places outside of an image slowly
        columns = self._everywhere[: len(image)]
        image[:] = self._ahead(columns, np.broadcast_to(rows, columns.shape), yaw_rad)

    def mirror_image(self, yaw_rad: float) -> Image:
        """The backdrop mirrored below the horizon as in still water, BGR, black above."""
        below = self._ahead(*self._mirror, yaw_rad)
        image = np.zeros((self._camera.height_px, self._camera.width_px, 3), np.uint8)
        image[len(image) - len(below) :] = below[:, :, :3]
        return image

    def _ahead(self, columns: Floats, rows: Floats, yaw_rad: float) -> Image:
        """The panorama at ``columns`` and ``rows``, rotated by ``yaw_rad``, BGRA."""
        ahead = np.float32(-yaw_rad * WIDTH / math.tau % WIDTH + WIDTH / 2)
        border = cv2.BORDER_REPLICATE
        image = cv2.remap(self._twice_around, columns + ahead, rows, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(image, np.uint8)

    @cached_property
    def _everywhere(self) -> Floats:
        return _panorama_columns(self._camera, 0, self._camera.height_px)[0]

    @cached_property
    def _mirror(self) -> tuple[Floats, Floats]:
        camera = self._camera
        first = max(self.rows - MIRROR_MARGIN_PX, 0)
        columns, v = _panorama_columns(camera, first, camera.height_px)
        up = np.abs(v - camera.horizon_row_px)
        return columns, (HEIGHT - BELOW - up).astype(np.float32)


def _panorama_columns(camera: Camera, first: int, last: int) -> tuple[Floats, NDArray[np.int_]]:
    """Column of the panorama, and row of the image, for every pixel of rows ``first`` to below ``last``."""
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(first, last))
    right = np.arctan((u - camera.cx_px) / camera.fx_px) - camera.yaw_rad
    return (right * WIDTH / math.tau).astype(np.float32), v


@lru_cache(maxsize=2)  # the cameras of one road share it
def _panorama(seed: int) -> Image:
    """The full turn, (HEIGHT, WIDTH, 3); the horizon lies BELOW rows above its lower end."""
    rng = np.random.default_rng((seed, 4))
    above = (HEIGHT - BELOW - np.arange(HEIGHT, dtype=np.float32))[:, None]
    zenith, horizon = np.array(SKIES_BGR[int(rng.integers(len(SKIES_BGR)))], np.float32)
    clouds = smooth_noise(rng, (HEIGHT, WIDTH), (16, 64)) + 0.5 * smooth_noise(rng, (HEIGHT, WIDTH), (4, 16))
    white = np.clip(clouds * 0.5 - 0.1 + rng.uniform(-0.3, 0.3), 0, 0.7)[:, :, None]
    clear = horizon + np.clip(above / 120, 0, 1)[:, :, None] * (zenith - horizon)
    image = np.asarray(clear + white * (245 - clear), np.float32)
    layers = (  # mean height, cell and height of its outline, colour
        (rng.uniform(4, 14), 64, 5.0, horizon * 0.75 + (35, 20, 10)),
        (rng.uniform(2, 7), 16, 3.0, np.array((70, 92, 72)) * rng.uniform(0.8, 1.2)),
        (rng.uniform(1, 3), 4, 1.6, np.array((40, 62, 48)) * rng.uniform(0.8, 1.3)),
    )
    low = slice(HEIGHT - LAND, HEIGHT)
    for mean, cell, rough, bgr in layers:
        outline = (
            mean + rough * smooth_noise(rng, (1, WIDTH), (1, cell)) + smooth_noise(rng, (1, WIDTH), (1, 4))
        )
        cover = np.clip(np.maximum(outline, 0.5) - above[low] + 0.5, 0, 1)[:, :, None]
        image[low] += cover * (bgr - image[low])
    return np.clip(image, 0, 255).astype(np.uint8)
