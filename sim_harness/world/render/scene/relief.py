"""The ground of a road with an elevation profile, level across or banked, as the camera sees it, and what it hides.

The vehicle stands on the tangent of the profile at its rear axle, and the camera turns with it. Ahead the ground
rises above the tangent by

    u(X) = z(s + ℓ) - z(s) - g·X

with the grade g here and ℓ the distance along the lane at which its centre lies X ahead; across the direction of
view the ground is level. For grades below 0.1 lengths along the tangent are within 0.5 % of those in plan. Seen by
a camera without roll, at height h and with the pitch p, the ground at X ahead of the lens fills one row:

    v = c_y + f_y·((h - u)·cos p - X·sin p)/D,    D = X·cos p + (h - u)·sin p

with the optical depth D, which is X·cos θ/cos(p + θ) along the row at tan θ = (v - c_y)/f_y. From near to far the
ground is visible where v falls below all rows before: else something nearer hides it. Between the places computed
1/X is linear in the row, nearly as on a plane.

What is known along every COLUMNS_PX-th column is linear between them.

**A banked road** (:class:`BankedRelief`). The vehicle stands on the plane of the road at its rear axle, with the
grade g and the bank φ there, and the camera turns with it. At X ahead and Y to the left the ground rises above this
plane by

    u(X, Y) = Z(s + ℓ, t) - Z(s, t₀) - g·X - tan φ·Y        Z(s, t) = z(s) + t·tan φ(s)

with the station s + ℓ at which the centre of the lane lies X ahead, the offset t of the place from this centre, and
t₀ that of the rear axle. So a row of the image no longer shows one distance. The rows of the ground are computed as
above, along every COLUMNS_PX-th column. The horizon tilts by the bank.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property

import cv2
import numpy as np

from sim_harness.world.roads.elevation import BANKED_WITHIN_M
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image

NEAREST_M, FARTHEST_M = 0.3, 320.0  # ground ahead of the lens
ALONG_M = np.concatenate([np.arange(0.0, 60.0, 1.0), np.arange(60.0, FARTHEST_M + 6.0, 3.0)])
"""Distances along the lane at which its profile is read."""
AHEAD_M = np.geomspace(NEAREST_M, FARTHEST_M, 180)
COLUMNS_PX = 32
STEEPEST_RAY_RAD = 1.5  # below the horizon of the vehicle
SLACK_M = 1.0  # a thing touches the ground that is this much nearer than its middle


class Relief:
    """The ground ahead of one pose."""

    def __init__(
        self, road: Road, camera: Camera, station_m: float, pose: tuple[float, float, float]
    ) -> None:
        """``pose``: x, y, yaw of the rear axle; ``camera``: without distortion."""
        x_m, y_m, yaw_rad = pose
        self._camera, self.width_px = camera, camera.width_px
        self.heading_rad = yaw_rad + camera.yaw_rad  # of the camera
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self.lens_m = (x_m + cos * camera.x_m - sin * camera.y_m, y_m + sin * camera.x_m + cos * camera.y_m)
        self.grade = road.grade_at(station_m)
        self._places_m = road.positions(station_m + ALONG_M, np.zeros(len(ALONG_M))) - self.lens_m
        forward_m = self._places_m @ (math.cos(self.heading_rad), math.sin(self.heading_rad))
        farther_m = np.maximum.accumulate(forward_m + 1e-6 * ALONG_M)
        heights_m = road.heights_at(station_m + ALONG_M)
        level_m = heights_m - heights_m[0] - self.grade * (farther_m - forward_m[0])
        self._profile = farther_m, level_m

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

    @cached_property
    def columns(self) -> Array:
        """The columns of the image along which the ground is computed: middles of blocks, one beyond each side."""
        blocks = np.arange(-1, math.ceil(self._camera.width_px / COLUMNS_PX) + 1)
        return np.asarray((blocks + 0.5) * COLUMNS_PX - 0.5)

    @cached_property
    def aside(self) -> Array:
        """Distance of these columns left of the camera's axis per optical depth."""
        return (self._camera.cx_px - self.columns) / self._camera.fx_px

    @cached_property
    def tops(self) -> Array:
        """Row of the farthest visible ground in each of these columns."""
        return np.array([rows[0] for rows, _ in self._sight_lines]) + np.zeros(len(self.columns))

    def nearness_1pm(self, rows: Array) -> Array:
        """1/X of the ground in rows, (rows, computed columns); above the ground that of its rim."""
        known = np.array([np.interp(rows, *seen) for seen in self._sight_lines])
        return np.broadcast_to(known.T, (len(rows), len(self.columns)))

    @property
    def horizon_row(self) -> float | Array:
        """Row of the true horizon, that of a level plane far below; of each column where it is not level."""
        camera = self._camera
        return camera.cy_px - camera.fy_px * math.tan(camera.pitch_down_rad - math.atan(self.grade))

    def camera_at(self, x_m: float, y_m: float) -> Camera:
        """The camera as it sees a thing on the ground at (x, y): lower by the height of the ground there."""
        height_m = self._camera.height_m - self.lift_at(x_m, y_m)
        return self._camera.model_copy(update={"height_m": height_m})

    def _lifts_m(self) -> Array:
        """The ground at AHEAD_M along each computed column, (computed, AHEAD_M)."""
        return self.lift_m(AHEAD_M)[None]

    @cached_property
    def _sight_lines(self) -> list[tuple[Array, Array]]:
        """Rows and 1/X of what is visible along each computed column, from far to near."""
        camera = self._camera
        cos, sin = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad)
        down_m = camera.height_m - self._lifts_m()
        row = camera.cy_px + camera.fy_px * (down_m * cos - AHEAD_M * sin) / (AHEAD_M * cos + down_m * sin)
        before = np.minimum.accumulate(row, axis=1)
        visible = np.ones(row.shape, bool)
        visible[:, 1:] = row[:, 1:] < before[:, :-1]
        return [(r[v][::-1], 1 / AHEAD_M[v][::-1]) for r, v in zip(row, visible, strict=True)]


def between_columns(known: Array, width_px: int) -> Floats:
    """Values of every column of an image, (rows, columns), linear between ``known`` ones of ``Relief.columns``."""
    size = (known.shape[1] * COLUMNS_PX, len(known))
    wide = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide[:, COLUMNS_PX : COLUMNS_PX + width_px], np.float32)


def depth_per_ahead(camera: Camera, rows: Array) -> Array:
    """Optical depth of the ground in rows per distance ahead of the lens, D/X = cos θ/cos(p + θ), (rows,)."""
    angle = np.arctan((rows - camera.cy_px) / camera.fy_px)
    below = np.clip(camera.pitch_down_rad + angle, -STEEPEST_RAY_RAD, STEEPEST_RAY_RAD)
    return np.asarray(np.cos(angle) / np.cos(below))


@contextmanager
def behind(image: Image, cover_m: Floats | None, reach_m: float) -> Iterator[None]:
    """Within the context a thing ``reach_m`` from the lens is drawn; after it ``image`` shows what hides it.

    ``cover_m``: distance from the lens of ground and walls, (rows, columns); None: nothing hides things.
    """
    before = None if cover_m is None else image.copy()
    yield
    if cover_m is not None and before is not None:
        hidden = cover_m < reach_m - SLACK_M
        image[hidden] = before[hidden]


def camera_at(camera: Camera, relief: Relief | None, x_m: float, y_m: float) -> Camera:
    """The camera as it sees a thing on the ground at (x, y) in vehicle axes."""
    return camera if relief is None else relief.camera_at(x_m, y_m)


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
