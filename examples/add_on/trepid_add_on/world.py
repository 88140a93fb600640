"""A world: a car on a ring between two white lines, drawn from above and seen by the camera of the car.

This stands for any other simulator: it has no clock, and Trepid knows nothing of its road.
"""

import math

import cv2
import numpy as np

from sim_harness.lockstep.foreign import WorldState
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Command
from trepid.types import Image

PIXEL_M, LINE_M, MARGIN_M, LAG_S = 0.05, 0.15, 10.0, 0.1
ASPHALT, WHITE, SKY = (90, 90, 90), (235, 235, 235), (200, 170, 140)


class Ring:
    """A kinematic car that drives counter-clockwise; its wheels follow the command with a lag."""

    def __init__(
        self,
        camera: Camera,
        vehicle: Vehicle,
        *,
        seed: int,
        radius_m: float = 40.0,
        lane_width_m: float = 3.5,
    ) -> None:
        self._camera, self._wheelbase_m = camera, vehicle.wheelbase_m
        self._radius_m, self._lane_width_m = radius_m, lane_width_m
        self._random = np.random.default_rng(seed)
        self._half_m = radius_m + lane_width_m + MARGIN_M
        self._floor = self._draw()
        self._x_m, self._y_m, self._yaw_rad, self._turned_rad = radius_m, 0.0, math.pi / 2, 0.0
        self._speed_mps = self._angle_rad = 0.0

    def state(self) -> WorldState:
        """The state; on a ring all of the lane follows from the place."""
        return WorldState(
            x_m=self._x_m,
            y_m=self._y_m,
            yaw_rad=self._yaw_rad,
            speed_mps=self._speed_mps,
            yaw_rate_radps=self._speed_mps * math.tan(self._angle_rad) / self._wheelbase_m,
            road_wheel_angle_rad=self._angle_rad,
            station_m=self._radius_m * self._turned_rad,
            lateral_offset_m=self._radius_m - math.hypot(self._x_m, self._y_m),
            heading_error_rad=math.remainder(self._yaw_rad - self._bearing_rad - math.pi / 2, math.tau),
            lane_width_m=self._lane_width_m,
        )

    def curvature_at(self, ahead_m: float) -> float:
        """That of the ring, everywhere."""
        return 1.0 / self._radius_m

    def advance(self, command: Command, period_s: float) -> None:
        """One step of the bicycle model."""
        before_rad = self._bearing_rad
        self._angle_rad += (command.road_wheel_angle_rad - self._angle_rad) * min(period_s / LAG_S, 1.0)
        self._speed_mps = max(self._speed_mps + command.accel_mps2 * period_s, 0.0)
        self._yaw_rad += self._speed_mps * math.tan(self._angle_rad) / self._wheelbase_m * period_s
        self._x_m += self._speed_mps * math.cos(self._yaw_rad) * period_s
        self._y_m += self._speed_mps * math.sin(self._yaw_rad) * period_s
        self._turned_rad += math.remainder(self._bearing_rad - before_rad, math.tau)

    def recentre(self) -> None:
        """Back onto the centre, along it."""
        bearing_rad = self._bearing_rad
        self._x_m, self._y_m = self._radius_m * math.cos(bearing_rad), self._radius_m * math.sin(bearing_rad)
        self._yaw_rad = bearing_rad + math.pi / 2

    def picture(self) -> Image:
        """The floor seen by the camera, by one homography; noise, and the sky above."""
        camera = self._camera
        ahead, left = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        x0_m, y0_m = self._x_m + self._half_m, self._y_m + self._half_m
        floor_from_car = [[ahead, -left, x0_m], [left, ahead, y0_m], [0, 0, PIXEL_M]]
        picture_from_floor = camera.pixel_from_road_matrix @ np.linalg.inv(floor_from_car)
        size = (camera.width_px, camera.height_px)
        seen = cv2.warpPerspective(self._floor, picture_from_floor, size, borderValue=ASPHALT)
        seen[: max(math.ceil(camera.horizon_row_px), 0)] = SKY
        return np.clip(seen + self._random.normal(0.0, 4.0, seen.shape), 0, 255).astype(np.uint8)

    @property
    def _bearing_rad(self) -> float:
        return math.atan2(self._y_m, self._x_m)

    def _draw(self) -> Image:
        """The ring from above, x to the right and y down."""
        size = int(2 * self._half_m / PIXEL_M)
        floor = np.full((size, size, 3), ASPHALT, np.uint8)
        for side in (-0.5, 0.5):
            radius_px = round((self._radius_m + side * self._lane_width_m) / PIXEL_M)
            cv2.circle(floor, (size // 2, size // 2), radius_px, WHITE, round(LINE_M / PIXEL_M), cv2.LINE_AA)
        return floor
