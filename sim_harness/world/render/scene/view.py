"""Rays of a pinhole camera, linear light, and the data of one frame.

Light is linear, 1 is a well-exposed white; grey levels are 255·√light (gamma 2, within 4 % of sRGB), so a
factor on the light is its square root on the grey levels.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from sim_harness.world.plants.springs import LEVEL, Attitude
from sim_harness.world.render.scene.painter import SHIFT, Pixels, Pose
from sim_harness.world.render.scene.relief import Relief
from sim_harness.world.render.scene.vehicles import Upright
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image

SKY_M = 1500.0  # distance of hills and sky for fog, rain and snow
AHEAD_M = np.concatenate([np.arange(0, 12, 0.5), np.arange(12, 40, 1.5), np.arange(40, 121, 8.0)])


def light_of(image: Image) -> Floats:
    """Linear light of grey levels, same shape."""
    light = np.asarray(image, np.float32) * np.float32(1 / 255)
    return np.asarray(cv2.multiply(light, light), np.float32)


def grey_of(light: Floats) -> Image:
    """Grey levels of linear light, saturated at 1."""
    return np.asarray(cv2.convertScaleAbs(cv2.sqrt(np.maximum(light, 0)), alpha=255), np.uint8)


def in_colour(image: Floats) -> Floats:
    return np.asarray(cv2.merge([image, image, image]), np.float32)


class View:
    """The directions of a camera's pixels, in vehicle axes."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
        rays = camera.optical_from_vehicle.T @ np.linalg.solve(camera.intrinsics, pixels)
        rays /= np.linalg.norm(rays, axis=0)
        self.rays = rays.reshape(3, *u.shape).astype(np.float32)  # forward, left, up

    @cached_property
    def distance_m(self) -> Floats:
        """From the lens to the flat ground along each ray, SKY_M at most and above the horizon."""
        down = np.maximum(-self.rays[2], self.camera.height_m / SKY_M)
        return np.asarray(self.camera.height_m / down, np.float32)

    @cached_property
    def along(self) -> Floats:
        """Distance ahead of the camera, in plan, per distance along each ray."""
        cos, sin = np.float32(math.cos(self.camera.yaw_rad)), np.float32(math.sin(self.camera.yaw_rad))
        return np.asarray(np.maximum(self.rays[0] * cos + self.rays[1] * sin, np.float32(1e-3)))

    @cached_property
    def fresnel(self) -> Floats:
        """Reflectance of still water on the ground: Schlick (1994), n = 1.33; 0 above the horizon."""
        upright = np.clip(-self.rays[2], 0, 1)
        return np.where(self.rays[2] < 0, 0.02 + 0.98 * (1 - upright) ** 5, 0).astype(np.float32)

    def pixels(self, points_m: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) and depths (n,) of points (x, y, z) in vehicle axes, (n, 3)."""
        camera = self.camera
        optical = camera.optical_from_vehicle @ (points_m - (camera.x_m, camera.y_m, camera.height_m)).T
        depth = np.maximum(optical[2], 1e-3)
        return (camera.intrinsics[:2] @ (optical / depth)).T, optical[2]


@dataclass(frozen=True, slots=True)
class ShutterMotion:
    """Motion of the vehicle while the shutter is open."""

    speed_mps: float = 0.0
    yaw_rate_radps: float = 0.0


STILL = ShutterMotion()


@dataclass(frozen=True, slots=True)
class Shot:
    road: Road
    pose: Pose  # of the rear axle
    station_m: float
    t_s: float
    motion: ShutterMotion
    vehicles: tuple[tuple[Pose, Upright], ...]  # poses in vehicle axes, from far to near
    sun_bearing_rad: float  # left of the camera's axis
    seed: int
    relief: Relief | None = None  # None: the ground is flat
    surface_m: Floats | None = None  # from the lens to ground and walls; None: flat and without walls
    attitude: Attitude = LEVEL  # of the body that carries the camera

    @property
    def frame(self) -> int:
        """A number of the frame, which seeds its noise."""
        return round(self.t_s * 1e4) % 2**63

    def from_world(self, points_m: Array) -> Array:
        """Points (x, y) of the world in vehicle axes, (n, 2)."""
        x, y, yaw = self.pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        return np.asarray((points_m - (x, y)) @ np.array([[cos, -sin], [sin, cos]]))

    def along(self, offset_m: float, ahead_m: Array = AHEAD_M) -> Array:
        """Points (x, y) in vehicle axes at an offset from the lane centre, ``ahead_m`` of the vehicle."""
        return self.from_world(self.road.positions(self.station_m + ahead_m, np.full(len(ahead_m), offset_m)))


def polygon(pixels: Array) -> Pixels:
    """Fixed-point corners for OpenCV's drawing with SHIFT."""
    return np.round(np.clip(pixels, -8000, 8000) * 2**SHIFT).astype(np.int32)
