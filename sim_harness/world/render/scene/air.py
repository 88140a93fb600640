"""Fog, drizzle, spray, rain and snow between scene and camera.

Koschmieder (1924): L = L₀·exp(-β d) + A·(1 - exp(-β d)), with the extinction β = 3 / visibility and the
airlight A; d is the distance to the ground by row, to a vehicle, or to the far sky.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import SHIFT, Pixels
from sim_harness.world.render.scene.relief import camera_at
from sim_harness.world.render.scene.vehicles import outline
from sim_harness.world.render.scene.view import Shot, View, in_colour, polygon
from trepid.types import Array, Floats, Image

AIRLIGHT_BGR = (0.66, 0.64, 0.62)  # of fog by day: grey 205
NEAREST_M, FARTHEST_M = 0.8, 10.0  # range in which single drops and flakes are drawn
RAIN_MPS, SNOW_MPS = 7.0, 1.2  # Gunn and Kinzer (1949): 2.5 mm drops; Langleben (1954): aggregates
RAIN_SHUTTER_S, SNOW_SHUTTER_S = 1 / 50, 1 / 80
STREAK_LIGHT = 0.8


def distances(view: View, shot: Shot) -> Floats:
    """Distance from the lens to the visible surface, (rows, columns) [m]."""
    still = view.distance_m if shot.surface_m is None else shot.surface_m
    shapes = [
        (pose, outline(camera_at(view.camera, shot.relief, *pose[:2]), body, pose), body)
        for pose, body in shot.vehicles
    ]
    if all(shape is None for _, shape, _ in shapes):
        return still
    distance = still.copy()
    for pose, shape, body in shapes:  # from far to near
        if shape is not None:
            reach = math.hypot(pose[0] + body.rear_m - view.camera.x_m, pose[1])
            cv2.fillConvexPoly(distance, shape, reach, cv2.LINE_8, SHIFT)
    return distance if shot.surface_m is None else np.minimum(distance, still)


def through_air(light: Floats, distance_m: Floats, extinction_1pm: float, airlight: float) -> Floats:
    """Koschmieder's law; ``airlight`` scales AIRLIGHT_BGR."""
    passed = in_colour(np.asarray(cv2.exp(distance_m * np.float32(-extinction_1pm)), np.float32))
    air = np.array(AIRLIGHT_BGR, np.float32) * np.float32(airlight)
    return np.asarray((light - air) * passed + air, np.float32)


def rain(light: Floats, view: View, shot: Shot, count: float, exposure_s: float) -> Floats:
    """``light`` with streaks of ``count`` drops."""
    rng = np.random.default_rng((shot.seed, shot.frame, 11))
    shutter_s = max(RAIN_SHUTTER_S, exposure_s)
    ends, depth = _paths(view, shot, rng, round(count), RAIN_MPS, shutter_s)
    mask = _draw_paths(light, ends, depth, ((5, 99, 34, 1), (2.2, 5, 44, 1), (0, 2.2, 34, 2)))
    cover = in_colour(np.asarray(mask * np.float32(1 / 255), np.float32))
    bright = STREAK_LIGHT * float(np.mean(light[: len(light) // 3])) + 0.25 * float(np.mean(light))
    return np.asarray(light + cover * (np.float32(bright) - 0.5 * light), np.float32)


def snowfall(light: Floats, view: View, shot: Shot, count: float, exposure_s: float) -> Floats:
    """``light`` with ``count`` flakes, near ones large and soft."""
    rng = np.random.default_rng((shot.seed, shot.frame, 12))
    ends, depth = _paths(view, shot, rng, round(count), SNOW_MPS, max(SNOW_SHUTTER_S, exposure_s))
    ranges = ((6, 99, 120, 1), (3.5, 6, 210, 1), (1.8, 3.5, 210, 2), (0, 1.8, 150, 4))
    mask = _draw_paths(light, ends, depth, ranges)
    mask = np.asarray(cv2.GaussianBlur(mask, (3, 3), 0), np.uint8)
    cover = in_colour(np.asarray(mask * np.float32(1 / 255), np.float32))
    white = 1.05 * float(np.mean(light[: len(light) // 3])) + 0.08 * float(np.mean(light))
    return np.asarray(light + cover * (np.float32(white) - light), np.float32)


def _draw_paths(
    light: Floats, ends: Pixels, depth: Array, ranges: Sequence[tuple[float, float, int, int]]
) -> Image:
    """A mask of the paths of particles; ``ranges``: nearest and farthest depth, strength and width."""
    mask = np.zeros(light.shape[:2], np.uint8)
    for near, far, strength, width in ranges:
        chosen = ends[(depth >= near) & (depth < far)]
        cv2.polylines(mask, list(chosen), False, strength, width, cv2.LINE_AA, SHIFT)
    return mask


def _paths(
    view: View, shot: Shot, rng: np.random.Generator, count: int, fall_mps: float, shutter_s: float
) -> tuple[Pixels, Array]:
    """Paths of ``count`` random particles while the shutter is open: ends (n, 2, 2) and depths."""
    rows, columns = view.distance_m.shape
    u, v = rng.integers(columns, size=count), rng.integers(rows, size=count)
    # Exponent 1/2 instead of 1/3: near particles are over-represented, as in images.
    depth = FARTHEST_M * rng.random(count) ** (1 / 2)
    gust = rng.normal(0, 0.15, (count, 3)) * fall_mps
    low = np.minimum(depth, view.distance_m[v, u])
    visible = (depth > NEAREST_M) & (low == depth)  # not below the ground
    camera = view.camera
    eye = np.array([camera.x_m, camera.y_m, camera.height_m])
    middle = view.rays[:, v, u].T.astype(float) * depth[:, None] + eye
    half = 0.5 * shutter_s * (np.array([-shot.motion.speed_mps, 0, -fall_mps]) + gust)
    ends, depths = zip(*(view.pixels(middle + sign * half) for sign in (-1, 1)), strict=True)
    visible &= np.minimum(*depths) > 0.3
    return polygon(np.stack(ends, axis=1)[visible]), depth[visible]
