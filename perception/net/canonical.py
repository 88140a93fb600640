"""Images of any camera, warped to the canonical camera of the network.

Turning a camera about its centre moves pixels by the homography K_c·R·K⁻¹ whatever the scene (Hartley and
Zisserman, Multiple View Geometry, 2004, section 8.4), so pitch, yaw, focal length and distortion are undone
exactly. The position of the camera remains. The canonical image of a camera at height h shows a world that is
s = h/h_c times as large: lengths from the network are multiplied by s, curvatures divided by s.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.types import Floats, Image

SUPERSAMPLE = 2  # per axis; then averaged, so that thin far lines survive the reduction
MIRRORED = np.array([-1, -1, -1, -1, 1], np.float32)
"""Factors that make the row of the mirrored image from that of an image."""


def lane_of_row(row: ArrayLike, lookahead_m: float) -> tuple[Lane, float]:
    """Lane and width [m] of the network's outputs.

    They are offset, heading, curvature at the axle and at ``lookahead_m``, and width.
    """
    offset, heading, curvature, ahead, width_m = map(float, np.asarray(row))
    return Lane(offset, heading, curvature, (ahead - curvature) / lookahead_m), width_m


def row_of_lane(lane: Lane, width_m: float, lookahead_m: float) -> Floats:
    """The inverse of :func:`lane_of_row`, shape (5,)."""
    ends_1pm = lane.curvature_1pm, lane.curvature_at(lookahead_m)
    return np.array([lane.offset_m, lane.heading_rad, *ends_1pm, width_m], np.float32)


def scale_lane(lane: Lane, scale: float) -> Lane:
    """The lane in a world that is ``scale`` times larger."""
    offset_m, heading_rad, curvature_1pm, rate_1pm2, ahead_m = lane
    return Lane(offset_m * scale, heading_rad, curvature_1pm / scale, rate_1pm2 / scale**2, ahead_m * scale)


def crop_camera(camera: Camera, *, top_px: int, bottom_px: int, width_px: int, height_px: int) -> Camera:
    """The camera of rows ``top_px`` to ``bottom_px`` only, resized to ``width_px`` x ``height_px``."""
    strip = camera.model_copy(update=dict(height_px=bottom_px - top_px, cy_px=camera.cy_px - top_px))
    return strip.resize(width_px, height_px)


class CanonicalView:
    """Warps images of one camera into the canonical camera and lane states back. Its map is computed once."""

    def __init__(self, camera: Camera, canonical: Camera) -> None:
        self.camera, self.canonical = camera, canonical
        fine = canonical.resize(SUPERSAMPLE * canonical.width_px, SUPERSAMPLE * canonical.height_px)
        self._shrink = shrink = max(1, int(camera.fx_px / fine.fx_px))
        self._size = (camera.width_px // shrink, camera.height_px // shrink)
        source = camera.resize(*self._size)
        self._map, self._fractions = cv2.initUndistortRectifyMap(
            source.intrinsics,
            camera.lens,
            canonical.optical_from_vehicle @ camera.optical_from_vehicle.T,
            fine.intrinsics,
            (fine.width_px, fine.height_px),
            cv2.CV_16SC2,
        )

    def image(self, image: Image) -> Image:
        """The image in the canonical camera, shape (canonical height, width, 3); black outside ``image``."""
        if self._shrink > 1:
            image = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        fine = cv2.remap(image, self._map, self._fractions, cv2.INTER_LINEAR)
        size = (self.canonical.width_px, self.canonical.height_px)
        return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.uint8)

    def lane(self, canonical_lane: Lane) -> Lane:
        """The lane at the vehicle's rear axle, from the lane in the canonical frame that the network returns.

        In the true world the canonical axle lies s·x_c behind the camera, on the camera's own line.
        """
        return scale_lane(canonical_lane, self.scale).in_frame_at(*self._axle_m)

    def canonical_lane(self, lane: Lane) -> Lane:
        """The inverse of :meth:`lane`."""
        ahead_m, left_m = self._axle_m
        return scale_lane(lane.in_frame_at(-ahead_m, -left_m), 1 / self.scale)

    @property
    def _axle_m(self) -> tuple[float, float]:
        """Place of the rear axle in the frame of the canonical one, ahead and left, in the true world."""
        ahead_m = self.scale * self.canonical.x_m - self.camera.x_m
        return ahead_m, self.scale * self.canonical.y_m - self.camera.y_m

    @property
    def scale(self) -> float:
        """s = h/h_c: ratio of the camera height to the canonical height."""
        return self.camera.height_m / self.canonical.height_m
