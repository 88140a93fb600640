"""The boundaries of a lane by length as pixels of the image."""

import cv2
import numpy as np

from perception.tape.curve import LaneCurve
from trepid.car.camera import Camera
from trepid.messages import PixelPath
from trepid.types import Array

NEAREST_M = 0.3  # before the lens
BESIDE = 1.0  # image widths to either side of the image


def boundary_pixels(lane: LaneCurve, camera: Camera) -> tuple[PixelPath, PixelPath]:
    """The left and the right boundary, from near to far along the lane, with lens distortion."""
    drawn = lane.draw()
    left, right = (drawn.centre + sign * 1j * lane.width_m / 2 * drawn.along for sign in (1.0, -1.0))
    return _pixels(left.real, left.imag, camera), _pixels(right.real, right.imag, camera)


def _pixels(x_m: Array, y_m: Array, camera: Camera) -> PixelPath:
    at = np.column_stack([x_m - camera.x_m, y_m - camera.y_m, np.full(len(x_m), -camera.height_m)])
    rays = at @ camera.optical_from_vehicle.T
    rays = rays[rays[:, 2] > np.maximum(NEAREST_M, np.abs(rays[:, 0]) / 3)]
    if len(rays) < 2:
        return ()
    zero = np.zeros(3)
    pixels = cv2.projectPoints(rays, zero, zero, camera.intrinsics, camera.lens)[0].reshape(-1, 2)
    near = (pixels[:, 0] > -BESIDE * camera.width_px) & (pixels[:, 0] < (1 + BESIDE) * camera.width_px)
    near &= (pixels[:, 1] > 0) & (pixels[:, 1] < 1.2 * camera.height_px)
    return tuple((float(u), float(v)) for u, v in pixels[near])
