"""The ground of a banked road, as the camera sees it.

The vehicle stands on the plane of the road at its rear axle, with the grade g and the bank φ there, and the camera
turns with it. At X ahead and Y to the left the ground rises above this plane by

    u(X, Y) = Z(s + ℓ, t) - Z(s, t₀) - g·X - tan φ·Y        Z(s, t) = z(s) + t·tan φ(s)

with the station s + ℓ at which the centre of the lane lies X ahead, the offset t of the place from this centre, and
t₀ that of the rear axle. So a row of the image no longer shows one distance. The rows of the ground are computed as
in :mod:`sim_harness.world.render.scene.relief`, along every COLUMNS_PX-th column; between columns 1/X is linear,
as it is exactly on a plane. The horizon tilts by the bank.
"""

import math

import numpy as np

from sim_harness.world.render.scene.relief import AHEAD_M, FARTHEST_M, PROFILE_M, Relief
from sim_harness.world.roads.elevation import BANKED_WITHIN_M
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Array

COLUMNS_PX = 20
STRIP_PX = 80  # drawn from one level of the ground


class BankedRelief(Relief):
    """The ground ahead of one pose on a banked road."""

    def __init__(
        self, road: Road, camera: Camera, station_m: float, pose: tuple[float, float, float]
    ) -> None:
        super().__init__(road, camera, station_m, pose)
        along_m = np.arange(0.0, FARTHEST_M + 2 * PROFILE_M, PROFILE_M)
        places_m = road.positions(station_m + along_m, np.zeros(len(along_m))) - self.lens_m
        centre_m = places_m @ (-math.sin(self.heading_rad), math.cos(self.heading_rad))
        banks = np.zeros(len(along_m)) if road.bank is None else road.bank.values_at(station_m + along_m)
        self._centre = self._profile[0], centre_m
        self._banks = self._profile[0], np.tan(banks)
        cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
        self._axle_m = camera.x_m * sin - camera.y_m * cos  # of the rear axle, left of the lens
        self._axle_offset_m = self._axle_m - float(centre_m[0])
        self._columns = np.arange(0, camera.width_px + COLUMNS_PX, COLUMNS_PX, dtype=float)
        self._aside = (camera.cx_px - self._columns) / camera.fx_px  # left of the axis, by depth
        self._seen = [self._visible(self._lift_along(aside)) for aside in self._aside.tolist()]
        self._tops = np.array([rows[0] for rows, _, _ in self._seen])
        self.top_row = float(self._tops.min())

    def strips(self, width_px: int) -> list[slice]:
        return [slice(first, min(first + STRIP_PX, width_px)) for first in range(0, width_px, STRIP_PX)]

    def ground(self, rows: Array, columns: slice) -> tuple[Array, Array]:
        wanted = np.arange(columns.start, columns.stop, dtype=float)
        first, last = columns.start // COLUMNS_PX, (columns.stop - 1) // COLUMNS_PX + 2
        known, seen = self._columns[first:last], self._seen[first:last]
        above = rows[:, None] < np.interp(wanted, known, self._tops[first:last])
        ahead_m, depth_m = (
            1
            / _between(np.array([np.interp(rows, each[0], 1 / each[place]) for each in seen]), known, wanted)
            for place in (1, 2)
        )
        ahead_m[above] = depth_m[above] = np.nan
        return ahead_m, depth_m

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
        slopes = self.grade + float(self._banks[1][0]) * self._aside_at(
            np.arange(camera.width_px, dtype=float)
        )
        return np.asarray(camera.cy_px - camera.fy_px * np.tan(camera.pitch_down_rad - np.arctan(slopes)))

    def _aside_at(self, columns: Array) -> Array:
        return (self._camera.cx_px - columns) / self._camera.fx_px

    def _lift_along(self, aside: float) -> Array:
        """The ground at AHEAD_M along a column."""
        camera = self._camera
        cos, sin = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad)
        up_m = np.zeros(len(AHEAD_M))
        for _ in range(2):  # how far left a column is depends, a little, on the height of the ground
            up_m = self.lift_beside(AHEAD_M, aside * (AHEAD_M * cos + (camera.height_m - up_m) * sin))
        return up_m


def _between(values: Array, known: Array, wanted: Array) -> Array:
    """``values`` (known, rows) at columns, linear between those known, as (rows, wanted)."""
    right = np.clip(np.searchsorted(known, wanted, side="right"), 1, len(known) - 1)
    share = (wanted - known[right - 1]) / (known[right] - known[right - 1])
    return np.asarray(values[right - 1].T * (1 - share) + values[right].T * share)
