"""Input of the lead detector: upright strips of the road ahead, all at one scale.

A vehicle stands on the road, so its distance determines the row of its lower edge and its size in the image.
The image is sampled on upright planes across the road at distances of constant ratio. On every plane a
vehicle has the same size in cells for any distance, lens and image size, so a small network has to learn one
size only.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.car.camera import Camera
from trepid.types import Image

FIRST_M, RATIO, STRIPS = 2.5, 1.13, 33
"""Distances from the camera: 2.5 m (in front of the bumper) to 125 m (a car is 3 px wide at 320 px)."""
ROW_M, ROWS, LOWEST_M = 0.1, 20, -0.35
COLUMN_M, COLUMNS = 0.2, 80
CELL_COLUMNS = COLUMNS // 2  # of the network's output
CELL_M = 2 * COLUMN_M
FINEST_PX_PER_M = 14.0  # finer images are averaged before sampling

Strips = NDArray[np.uint8]
"""Sampled strips, shape (STRIPS, ROWS, COLUMNS, 3): near to far, top to bottom, left to right, BGR."""

DISTANCES_M = FIRST_M * RATIO ** np.arange(STRIPS)
CELLS_LEFT_M = (CELL_COLUMNS / 2 - 0.5 - np.arange(CELL_COLUMNS)) * CELL_M
"""Lateral place of the output columns [m], + left of the camera, from left to right."""


class LeadView:
    """The strips of one camera."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        maps = [strip_pixels(camera, float(d)) for d in DISTANCES_M]
        levels = [max(0, math.ceil(math.log2(camera.fx_px / d / FINEST_PX_PER_M))) for d in DISTANCES_M]
        self._levels = [
            (level, [k for k in range(STRIPS) if levels[k] == level]) for level in range(max(levels) + 1)
        ]
        self._maps = {}
        for level, members in self._levels:
            if members:
                at = (np.concatenate([maps[k] for k in members]) + 0.5) / 2**level - 0.5
                x, y = np.ascontiguousarray(at.transpose(2, 0, 1), np.float32)
                self._maps[level] = cv2.convertMaps(x, y, cv2.CV_16SC2)

    def strips(self, image: Image) -> Strips:
        """``image`` sampled on every plane; black outside the image."""
        out = np.zeros((STRIPS, ROWS, COLUMNS, 3), np.uint8)
        for level, members in self._levels:
            if level:
                half = (max(image.shape[1] // 2, 1), max(image.shape[0] // 2, 1))
                image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint8)
            if members:  # levels grow as distances fall: the members are neighbours
                seen = out[members[0] : members[-1] + 1].reshape(-1, COLUMNS, 3)
                at, fraction = self._maps[level]
                cv2.remap(image, at, fraction, cv2.INTER_LINEAR, dst=seen)
        return out


def strip_pixels(camera: Camera, distance_m: float) -> NDArray[np.float64]:
    """Pixels (ROWS, COLUMNS, 2) of the plane ``distance_m`` ahead of the camera, upright and across the vehicle."""
    left_m = (COLUMNS / 2 - 0.5 - np.arange(COLUMNS)) * COLUMN_M
    up_m = LOWEST_M + (ROWS - 0.5 - np.arange(ROWS)) * ROW_M
    points = np.zeros((ROWS, COLUMNS, 3))
    points[..., 0] = distance_m
    points[..., 1] = left_m
    points[..., 2] = up_m[:, None] - camera.height_m
    optical = points.reshape(-1, 3) @ camera.optical_from_vehicle.T
    pixels, _ = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), camera.intrinsics, camera.lens)
    return np.asarray(np.reshape(pixels, (ROWS, COLUMNS, 2)), float)
