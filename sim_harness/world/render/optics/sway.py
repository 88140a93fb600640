"""The picture of a camera on a body that pitches and rolls, from the picture of one that does not.

A camera that turns about its lens sees the same rays: pixels of both pictures are related by the homography
K_e·O·B·Oᵀ·K⁻¹, with the intrinsics K and K_e, the rotation O of the mounting and the rotation B of the body. The
lens itself moves by some centimetres, which is left out. Hartley and Zisserman (2004), section 8.4.2.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.plants.springs import MOST_RAD, Attitude
from trepid.car.camera import Camera


class Sway:
    """Pictures of a camera by those of its ``eye``, which is fixed to the road and sees beyond all its edges."""

    def __init__(self, camera: Camera) -> None:
        """``camera``: without distortion."""
        self._camera = camera
        half_rad = math.atan(max(camera.cy_px, camera.height_px - camera.cy_px) / camera.fy_px)
        beside_px = math.ceil(MOST_RAD * max(camera.cy_px, camera.height_px - camera.cy_px)) + 2
        beyond_px = math.ceil(camera.fy_px * MOST_RAD / math.cos(half_rad) ** 2) + beside_px
        beyond_px += math.ceil(MOST_RAD * camera.width_px / 2)
        size = {"width_px": camera.width_px + 2 * beside_px, "height_px": camera.height_px + 2 * beyond_px}
        centre = {"cx_px": camera.cx_px + beside_px, "cy_px": camera.cy_px + beyond_px}
        self.eye = camera.model_copy(update=size | centre)
        self._from_ray = self.eye.intrinsics @ camera.optical_from_vehicle
        self._ray = camera.optical_from_vehicle.T @ np.linalg.inv(camera.intrinsics)

    def turn(self, picture: NDArray[Any], attitude: Attitude) -> NDArray[Any]:
        """The picture of the camera on a body with ``attitude``, from one of its eye."""
        size = (self._camera.width_px, self._camera.height_px)
        place = self._from_ray @ road_from_body(attitude) @ self._ray
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(
            cv2.warpPerspective(picture, place, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
        )


def road_from_body(attitude: Attitude) -> NDArray[np.float64]:
    """Rotation, shape (3, 3), from the axes of the body (forward, left, up) to those of the plane of the road."""
    cp, sp = math.cos(attitude.pitch_rad), math.sin(attitude.pitch_rad)
    cr, sr = math.cos(attitude.roll_rad), math.sin(attitude.roll_rad)
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(pitch @ roll, np.float64)
