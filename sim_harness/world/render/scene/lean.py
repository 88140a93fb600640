"""The ground of a banked road, as the camera sees it.

The vehicle stands on the plane of the road at its rear axle, with the grade g and the bank φ there, and the camera
turns with it. At X ahead and Y to the left the ground rises above this plane by

    u(X, Y) = Z(s + ℓ, t) - Z(s, t₀) - g·X - tan φ·Y        Z(s, t) = z(s) + t·tan φ(s)

with the station s + ℓ at which the centre of the lane lies X ahead, the offset t of the place from this centre, and
t₀ that of the rear axle. So a row of the image no longer shows one distance. The rows of the ground are computed as
in :mod:`sim_harness.world.render.scene.relief`, along every COLUMNS_PX-th column. The horizon tilts by the bank.
"""

import math

import numpy as np

from sim_harness.world.render.scene.relief import AHEAD_M, ALONG_M, Relief
from sim_harness.world.roads.elevation import BANKED_WITHIN_M
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Array


class BankedRelief(Relief):
    """The ground ahead of one pose on a banked road."""

    def __init__(
        self, road: Road, camera: Camera, station_m: float, pose: tuple[float, float, float]
    ) -> None:
        super().__init__(road, camera, station_m, pose)
        centre_m = self._places_m @ (-math.sin(self.heading_rad), math.cos(self.heading_rad))
        banks = np.zeros(len(ALONG_M)) if road.bank is None else road.bank.values_at(station_m + ALONG_M)
        self._centre = self._profile[0], centre_m
        self._banks = self._profile[0], np.tan(banks)
        cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
        self._axle_m = camera.x_m * sin - camera.y_m * cos  # of the rear axle, left of the lens
        self._axle_offset_m = self._axle_m - float(centre_m[0])

    def lift_beside(self, ahead_m: Array, left_m: Array) -> Array:
        """Height of the ground above the plane of the vehicle, this far ahead and left of the lens."""
        banks, own = np.interp(ahead_m, *self._banks), float(self._banks[1][0])
        offset_m = np.clip(left_m - np.interp(ahead_m, *self._centre), -BANKED_WITHIN_M, BANKED_WITHIN_M)
        across_m = offset_m * banks - own * (self._axle_offset_m + left_m - self._axle_m)
        return np.asarray(np.interp(ahead_m, *self._profile) + across_m)

    def lift_at(self, x_m: float, y_m: float) -> float:
        camera = self._camera
        cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
        x_m, y_m = x_m - camera.x_m, y_m - camera.y_m
        return float(self.lift_beside(np.array(x_m * cos + y_m * sin), np.array(y_m * cos - x_m * sin)))

    @property
    def horizon_row(self) -> Array:
        camera = self._camera
        aside = (camera.cx_px - np.arange(camera.width_px)) / camera.fx_px
        slopes = self.grade + float(self._banks[1][0]) * aside
        return np.asarray(camera.cy_px - camera.fy_px * np.tan(camera.pitch_down_rad - np.arctan(slopes)))

    def _lifts_m(self) -> Array:
        camera = self._camera
        cos, sin = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad)
        aside = self.aside[:, None]
        up_m = np.zeros((1, len(AHEAD_M)))
        for _ in range(2):  # how far left a column is depends, a little, on the height of the ground
            up_m = self.lift_beside(AHEAD_M, aside * (AHEAD_M * cos + (camera.height_m - up_m) * sin))
        return up_m
