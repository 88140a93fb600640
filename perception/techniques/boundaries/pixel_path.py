"""Boundaries on the road as polylines of the input image."""

import cv2
import numpy as np

from perception.techniques.image.picture import Boundary
from trepid.camera import Camera
from trepid.messages import PixelPath
from trepid.types import Array

ROW_STEP_PX = 10


def boundary_path(boundary: Boundary | None, camera: Camera) -> PixelPath:
    """Pixels (x, y) of the boundary in the distorted input image, one every ten rows from the bottom up."""
    if boundary is None:
        return ()
    pixels = _distorted(np.column_stack([boundary.x_m, boundary.y_m]), camera)
    if len(pixels) < 2:
        return ()
    rows = np.arange(camera.height_px // ROW_STEP_PX * ROW_STEP_PX, -1.0, -ROW_STEP_PX)
    order = np.argsort(pixels[:, 1])
    columns = np.interp(rows, pixels[order, 1], pixels[order, 0], left=np.nan, right=np.nan)
    near = (columns >= -camera.width_px) & (columns < 2 * camera.width_px)  # NaN is not near
    return tuple(zip(columns[near].tolist(), rows[near].tolist(), strict=True))


def _distorted(ground_m: Array, camera: Camera) -> Array:
    """Pixels, shape (n, 2), of the road points that lie ahead of the camera, with lens distortion."""
    points = np.column_stack([ground_m - [camera.x_m, camera.y_m], np.full(len(ground_m), -camera.height_m)])
    rays = points @ camera.optical_from_vehicle.T
    rays = rays[rays[:, 2] > 0.1]
    if not len(rays):
        return np.empty((0, 2))
    zero = np.zeros(3)
    distortion = np.array(camera.distortion or [0.0] * 4)
    pixels, _ = cv2.projectPoints(rays, zero, zero, camera.intrinsics, distortion)
    return np.asarray(pixels, float).reshape(-1, 2)
