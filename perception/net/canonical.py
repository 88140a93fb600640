"""Any camera's image as the one camera that the network knows would have seen it.

Turning a camera about its centre moves pixels by the homography K_c·R·K⁻¹ whatever the scene (Hartley and
Zisserman, Multiple View Geometry, 2004, section 8.4), so pitch, yaw, focal length and distortion are undone
exactly. What remains is the place of the camera. A camera at height h that sees the canonical image sees a world
that is s = h/h_c times larger than the network believes: lengths grow by s, curvature shrinks by s.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trepid.camera import Camera
from trepid.types import Image

SUPERSAMPLE = 2  # per axis; then averaged, so that thin far lines survive the shrinking


@dataclass(frozen=True, slots=True)
class Lane:
    """The lane as a clothoid, seen from the rear axle; fields as in :class:`trepid.messages.SteeringEstimate`."""

    offset_m: float
    heading_rad: float
    curvature_1pm: float  # at the axle
    curvature_rate_1pm2: float

    @classmethod
    def from_row(cls, row: ArrayLike, lookahead_m: float) -> "Lane":
        """From offset, heading, curvature at the axle and curvature at ``lookahead_m``: the network's terms."""
        offset, heading, curvature, ahead = map(float, np.asarray(row))
        return cls(
            offset_m=offset,
            heading_rad=heading,
            curvature_1pm=curvature,
            curvature_rate_1pm2=(ahead - curvature) / lookahead_m,
        )

    def row(self, lookahead_m: float) -> tuple[float, float, float, float]:
        """The opposite of ``from_row``."""
        ahead_1pm = self.curvature_1pm + self.curvature_rate_1pm2 * lookahead_m
        return self.offset_m, self.heading_rad, self.curvature_1pm, ahead_1pm

    def scaled(self, scale: float) -> "Lane":
        """The lane in a world that is ``scale`` times larger."""
        return Lane(
            offset_m=self.offset_m * scale,
            heading_rad=self.heading_rad,
            curvature_1pm=self.curvature_1pm / scale,
            curvature_rate_1pm2=self.curvature_rate_1pm2 / scale**2,
        )

    def seen_from(self, ahead_m: float, left_m: float) -> "Lane":
        """The lane seen from a point of the vehicle ``ahead_m`` and ``left_m`` of the present one.

        With the lane centre y(x) = −e − ψx + κ₀x²/2 + κ'x³/6: e becomes −y(ahead) + left, ψ becomes −y'(ahead)
        and κ₀ becomes y''(ahead).
        """
        x, kappa, rate = ahead_m, self.curvature_1pm, self.curvature_rate_1pm2
        return Lane(
            offset_m=self.offset_m + self.heading_rad * x - kappa * x**2 / 2 - rate * x**3 / 6 + left_m,
            heading_rad=self.heading_rad - kappa * x - rate * x**2 / 2,
            curvature_1pm=kappa + rate * x,
            curvature_rate_1pm2=rate,
        )


def cropped(camera: Camera, *, top_px: int, bottom_px: int, width_px: int, height_px: int) -> Camera:
    """The camera that sees only rows ``top_px`` to ``bottom_px``, resized to ``width_px`` x ``height_px``."""
    strip = camera.model_copy(update=dict(height_px=bottom_px - top_px, cy_px=camera.cy_px - top_px))
    return strip.resized(width_px, height_px)


class CanonicalView:
    """Warps images of one camera into the canonical camera and lane states back. Its map is computed once."""

    def __init__(self, camera: Camera, canonical: Camera) -> None:
        self.camera = camera
        self.canonical = canonical
        fine = canonical.resized(SUPERSAMPLE * canonical.width_px, SUPERSAMPLE * canonical.height_px)
        shrink = max(1, int(camera.fx_px / fine.fx_px))
        self._size = (camera.width_px // shrink, camera.height_px // shrink)
        self._shrink = shrink
        source = camera.resized(*self._size)
        self._map, self._fractions = cv2.initUndistortRectifyMap(
            source.intrinsics,
            np.array(camera.distortion or [0.0] * 5),
            canonical.optical_from_vehicle @ camera.optical_from_vehicle.T,
            fine.intrinsics,
            (fine.width_px, fine.height_px),
            cv2.CV_16SC2,
        )

    def image(self, image: Image) -> Image:
        """What the canonical camera would see, shape (canonical height, canonical width, 3); black where unseen."""
        if self._shrink > 1:
            image = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        fine = cv2.remap(image, self._map, self._fractions, cv2.INTER_LINEAR)
        size = (self.canonical.width_px, self.canonical.height_px)
        return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.uint8)

    def lane(self, canonical_lane: Lane) -> Lane:
        """The lane at the vehicle's rear axle, from the one that the network believes to see at the canonical one.

        In the true world the canonical axle lies s·x_c behind the camera, on the camera's own line.
        """
        scale = self.scale
        ahead_m = scale * self.canonical.x_m - self.camera.x_m
        return canonical_lane.scaled(scale).seen_from(ahead_m, scale * self.canonical.y_m - self.camera.y_m)

    @property
    def scale(self) -> float:
        """s = h/h_c: how many times larger the true world is than the network believes."""
        return self.camera.height_m / self.canonical.height_m
