"""Draws vehicles as plain cars, and what else moves on a road."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import NEAR_M, Colour, Painter, Pixels, Pose
from sim_harness.world.render.scene.people import Figure, draw_figure, figure_outline
from trepid.car.camera import Camera
from trepid.types import Image

FRONT_OVERHANG_M, WHEEL_M = 0.80, 0.32


@dataclass(frozen=True, slots=True)
class Body:
    """A passenger car; x is counted from the rear axle."""

    rear_m: float = -0.85
    front_m: float = 3.40
    width_m: float = 1.78
    height_m: float = 1.48
    waist_m: float = 0.92  # lower edge of the windows
    clearance_m: float = 0.22
    bgr: Colour = (120, 60, 40)


Upright = Body | Figure
"""A vehicle, person, cyclist or animal."""


def draw_lead(image: Image, camera: Camera, body: Upright, pose: Pose, *, mirrored: bool = False) -> None:
    """Draw ``body`` at ``pose`` in the camera's vehicle frame into ``image``; nothing when it is behind.

    ``mirrored``: as the reflection on a wet road, upside down and without a shadow.
    """
    if isinstance(body, Figure):
        draw_figure(image, camera, body, pose, mirrored=mirrored)
        return
    if pose[0] + math.hypot(body.front_m, body.width_m) < camera.x_m + NEAR_M:
        return
    half = body.width_m / 2
    painter = Painter(image, camera, pose, mirrored=mirrored)
    if not mirrored:
        painter.shadow(body.rear_m - 0.15, body.front_m, half + 0.12)
    axle_m = body.front_m - FRONT_OVERHANG_M
    for x0, x1 in ((-WHEEL_M, WHEEL_M), (axle_m - WHEEL_M, axle_m + WHEEL_M)):
        for y in (-half, half):
            painter.face([(x0, y, 0.0), (x1, y, 0.0), (x1, y, 0.6), (x0, y, 0.6)], (28, 28, 28))
    for y0, y1 in ((-half, -half + 0.2), (half - 0.2, half)):
        painter.face([(-0.3, y, z) for y, z in ((y0, 0), (y1, 0), (y1, 0.4), (y0, 0.4))], (22, 22, 22))
    painter.box((body.rear_m, body.front_m), half, half, (body.clearance_m, body.waist_m), body.bgr)
    _draw_cabin(painter, body, half)
    for x, seen in ((body.rear_m, painter.faces_rear), (body.front_m, painter.faces_front)):
        if seen(x):
            for y0, y1, z0, z1, bgr in _end_faces(body, half, rear=x == body.rear_m):
                painter.face([(x, y0, z0), (x, y1, z0), (x, y1, z1), (x, y0, z1)], bgr)


def _end_faces(body: Body, half: float, *, rear: bool) -> list[tuple[float, float, float, float, Colour]]:
    """Bumper, lamps and number plate of the rear, or bumper, grille and headlamps of the front: y, z, colour."""
    lamp, bumper, low = (0.32 if rear else 0.36), (38, 38, 40), body.clearance_m
    if rear:
        return [
            (-half, half, low, 0.42, bumper),
            *((y, y + lamp, 0.68, 0.86, (40, 30, 190)) for y in (-half, half - lamp)),
            (-0.26, 0.26, 0.52, 0.63, (225, 225, 225)),
        ]
    return [
        (-half, half, low, 0.40, bumper),
        (-0.5, 0.5, 0.48, 0.66, (30, 30, 32)),
        *((y, y + lamp, 0.58, 0.76, (235, 235, 230)) for y in (-half, half - lamp)),
    ]


def _draw_cabin(painter: Painter, body: Body, half_m: float) -> None:
    x = (body.rear_m + 0.25, body.front_m - 1.5)
    roof_half, glass = half_m - 0.16, (58, 52, 48)
    painter.box(x, half_m - 0.05, roof_half, (body.waist_m, body.height_m - 0.08), glass)
    painter.box(x, roof_half + 0.02, roof_half, (body.height_m - 0.08, body.height_m), body.bgr)


def outline(camera: Camera, body: Upright, pose: Pose) -> Pixels | None:
    """Fixed-point convex outline of a figure, or of the box around a vehicle; None when it is behind the lens."""
    if isinstance(body, Figure):
        return figure_outline(camera, body, pose)
    painter = Painter(np.empty((0, 0, 3), np.uint8), camera, pose)
    half = body.width_m / 2
    ends = [
        [(x, y, z) for y in (-half, half) for z in (0.0, body.height_m)] for x in (body.rear_m, body.front_m)
    ]
    corners = [painter.project(np.array([a, b])) for a, b in zip(*ends, strict=True)]
    return np.asarray(cv2.convexHull(np.concatenate(corners)), np.int32) if any(map(len, corners)) else None
