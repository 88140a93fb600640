"""The ground of a road with an elevation profile, as the camera sees it.

The vehicle stands on the tangent of the profile at its rear axle, and the camera turns with it. Ahead the ground
rises above the tangent by

    u(X) = z(s + ℓ) - z(s) - g·X

with the grade g here and ℓ the distance along the lane at which its centre lies X ahead; across the direction of
view the ground is level. For grades below 0.1 lengths along the tangent are within 0.5 % of those in plan. Seen by
a camera without roll, at height h and with the pitch p, the ground at X ahead of the lens fills one row:

    v = c_y + f_y·((h - u)·cos p - X·sin p)/depth,    depth = X·cos p + (h - u)·sin p

From near to far the ground is visible where v falls below all rows before: else something nearer hides it.
"""

import math

import numpy as np

from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Array

NEAREST_M, FARTHEST_M = 0.3, 320.0  # ground ahead of the lens
PROFILE_M = 1.0  # between the places at which the profile is read
AHEAD_M = np.geomspace(NEAREST_M, FARTHEST_M, 640)


class Relief:
    """The ground ahead of one pose."""

    def __init__(
        self, road: Road, camera: Camera, station_m: float, pose: tuple[float, float, float]
    ) -> None:
        """``pose``: x, y, yaw of the rear axle; ``camera``: without distortion."""
        x_m, y_m, yaw_rad = pose
        self._camera = camera
        self.heading_rad = yaw_rad + camera.yaw_rad  # of the camera
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self.lens_m = (x_m + cos * camera.x_m - sin * camera.y_m, y_m + sin * camera.x_m + cos * camera.y_m)
        self.grade = road.grade_at(station_m)
        along_m = np.arange(0.0, FARTHEST_M + 2 * PROFILE_M, PROFILE_M)
        places_m = road.positions(station_m + along_m, np.zeros(len(along_m))) - self.lens_m
        forward_m = places_m @ (math.cos(self.heading_rad), math.sin(self.heading_rad))
        farther_m = np.maximum.accumulate(forward_m + 1e-6 * along_m)
        heights_m = road.heights_at(station_m + along_m)
        level_m = heights_m - heights_m[0] - self.grade * (farther_m - forward_m[0])
        self._profile = farther_m, level_m
        self._rows, self._seen_m, self._depth_m = self._visible(self.lift_m(AHEAD_M))
        self.top_row = float(self._rows[0])  # of the farthest visible ground

    def lift_m(self, ahead_m: Array | float) -> Array:
        """Height of the ground above the plane of the vehicle, this far ahead of the lens; 0 behind it."""
        ahead = np.asarray(ahead_m, float)
        lift = np.interp(ahead, *self._profile)
        return np.asarray(np.where(ahead > 0, lift, 0.0))

    def lift_at(self, x_m: float, y_m: float) -> float:
        """Height of the ground above the plane of the vehicle at a place in its axes."""
        camera = self._camera
        cos, sin = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
        return float(self.lift_m((x_m - camera.x_m) * cos + (y_m - camera.y_m) * sin))

    def strips(self, width_px: int) -> list[slice]:
        """Columns of an image that are drawn together."""
        return [slice(0, width_px)]

    def ground(self, rows: Array, _columns: slice) -> tuple[Array, Array]:
        """Distance ahead and optical depth of the ground, (rows, 1) or (rows, columns); NaN above the ground."""
        ahead_m, depth_m = self.at_rows(rows)
        return ahead_m[:, None], depth_m[:, None]

    def at_rows(self, rows: Array) -> tuple[Array, Array]:
        """Distance ahead of the lens, and optical depth, of the ground in rows; NaN above the ground."""
        ahead_m, depth_m = (np.interp(rows, self._rows, of) for of in (self._seen_m, self._depth_m))
        above = rows < self.top_row
        return np.where(above, np.nan, ahead_m), np.where(above, np.nan, depth_m)

    @property
    def horizon_row(self) -> float | Array:
        """Row of the true horizon, that of a level plane far below; of each column where it is not level."""
        camera = self._camera
        return camera.cy_px - camera.fy_px * math.tan(camera.pitch_down_rad - math.atan(self.grade))

    def camera_at(self, x_m: float, y_m: float) -> Camera:
        """The camera as it sees a thing on the ground at (x, y): lower by the height of the ground there."""
        height_m = self._camera.height_m - self.lift_at(x_m, y_m)
        return self._camera.model_copy(update={"height_m": height_m})

    def _visible(self, up_m: Array) -> tuple[Array, Array, Array]:
        """Row, distance ahead and optical depth of what is visible of ground ``up_m`` high, from far to near."""
        depth_m, row = self._ground_rows(AHEAD_M, up_m)
        visible = row < np.concatenate([[np.inf], np.minimum.accumulate(row)[:-1]])
        return row[visible][::-1], AHEAD_M[visible][::-1], depth_m[visible][::-1]

    def _ground_rows(self, ahead_m: Array, up_m: Array) -> tuple[Array, Array]:
        """Optical depth and row of the ground."""
        camera = self._camera
        cos, sin = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad)
        down_m = camera.height_m - up_m
        depth_m = ahead_m * cos + down_m * sin
        return depth_m, camera.cy_px + camera.fy_px * (down_m * cos - ahead_m * sin) / depth_m
