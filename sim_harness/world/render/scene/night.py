"""Night: ambient light, headlights, tail lamps of other vehicles."""

import math

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import SHIFT
from sim_harness.world.render.scene.relief import SLACK_M, camera_at
from sim_harness.world.render.scene.vehicles import Body, outline
from sim_harness.world.render.scene.view import SKY_M, Shot, View, in_colour
from sim_harness.world.roads.disturbance_table import Night, at
from trepid.types import Array, Floats

LAMP_AHEAD_M, LAMP_SIDE_M, LAMP_UP_M = 1.0, 0.55, 0.65  # from the camera, from the middle, above the road
AXIS_M = 10.0  # distance at which the beam has brightness 1
SPREAD_RAD = 0.30  # of the beam to each side, standard deviation
AXIS = 0.47  # of a beam 10 m ahead on the road: 3.1 degrees below the cut-off
DROP_RAD = 0.075  # angle below the cut-off over which the beam weakens by e
CUT_OFF_RAD = -0.010  # UN R112: 1 % below the horizon ...
KINK = 0.268  # ... rising by 15 degrees to the right
KINK_RAD = 0.02
STRAY = 0.012  # light above the cut-off
# Exponent of retroreflection by glass beads: R_L of markings is 5 to 10 times asphalt's (EN 1436), diffuse 3 times.
RETRO = 1.35
SKY_SHARE = 0.35  # brightness of the night sky relative to the ambient light
LAMP_BGR = (0.78, 0.92, 1.0)
TAIL_BGR = (0.08, 0.06, 1.0)
NIGHT_BGR = (1.12, 1.0, 0.88)


class Headlights:
    """The light of the own low beams in every pixel, relative to AXIS_M straight ahead."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._ground = np.where(view.rays[2] < 0, self._on(view.distance_m), 0).astype(np.float32)

    def _on(self, distance_m: Floats) -> Floats:
        """Illuminance of a surface this far away along each ray."""
        camera = self._view.camera
        origin = np.array([camera.x_m, camera.y_m, camera.height_m])
        points = self._view.rays * distance_m + origin[:, None, None].astype(np.float32)
        return beams(points[0] - camera.x_m, points[1], points[2])

    def light(self, scene: Floats, shot: Shot, settings: Night, grade: float) -> Floats:
        """``scene`` by night: the ambient light and the beams, whose illuminance falls with 1/distance²."""
        ambient, lamp = at(settings.ambient, grade), at(settings.headlight, grade)
        still_m = shot.surface_m
        ground = self._ground if still_m is None else np.where(still_m < SKY_M, self._on(still_m), 0)
        thrown_on = ground * np.float32(lamp)
        for pose, body in shot.vehicles:
            shape = outline(camera_at(self._view.camera, shot.relief, *pose[:2]), body, pose)
            if shape is not None:
                before = None if still_m is None else thrown_on.copy()
                place = np.array([pose[0] + body.rear_m - self._view.camera.x_m, pose[1], 0.5], np.float32)
                near = lamp * float(beams(*place[:, None])[0])
                cv2.fillConvexPoly(thrown_on, shape, near, cv2.LINE_8, SHIFT)
                if before is not None and still_m is not None:
                    hidden = still_m < math.hypot(float(place[0]), pose[1]) - SLACK_M
                    thrown_on[hidden] = before[hidden]
        sky = np.where(self._view.rays[2] > 0, np.float32(SKY_SHARE), np.float32(1))
        dusk = min(4 * (1 - ambient), 1.0)
        day = np.array(NIGHT_BGR, np.float32) * dusk + (1 - dusk)
        dark = scene * (in_colour(np.asarray(sky * ambient)) * day)
        thrown = cv2.pow(np.maximum(scene, 1e-4), RETRO)
        lit = np.asarray(thrown * (in_colour(thrown_on) * np.array(LAMP_BGR, np.float32)), np.float32)
        return self._tail_lamps(dark + lit, shot, 1 - ambient)

    def _tail_lamps(self, light: Floats, shot: Shot, share: float) -> Floats:
        """``light`` with red tail lamps and their halo."""
        for (x, y, yaw), body in shot.vehicles:
            for side in (-1, 1) if isinstance(body, Body) else ():
                across = side * (body.width_m / 2 - 0.16)
                place = (
                    x + body.rear_m * math.cos(yaw) - across * math.sin(yaw),
                    y + body.rear_m * math.sin(yaw) + across * math.cos(yaw),
                    0.77 + (0.0 if shot.relief is None else shot.relief.lift_at(x, y)),
                )
                pixel, depth = self._view.pixels(np.array([place]))
                if depth[0] > 1.0 and math.cos(yaw) > 0 and not _is_hidden(shot, pixel[0], float(depth[0])):
                    _glow(light, pixel[0], 0.12 * self._view.camera.fx_px / depth[0], share)
        return light


def _is_hidden(shot: Shot, pixel: Array, depth_m: float) -> bool:
    """Whether a wall or a crest hides a place."""
    if shot.surface_m is None:
        return False
    rows, columns = shot.surface_m.shape
    u, v = round(float(pixel[0])), round(float(pixel[1]))
    return 0 <= v < rows and 0 <= u < columns and bool(shot.surface_m[v, u] < depth_m - SLACK_M)


def beams(ahead_m: Floats, left_m: Floats, up_m: Floats) -> Floats:
    """Illuminance by both lamps of a surface that faces them, AXIS_M straight ahead on the road 1.

    Places ahead of the camera, left of the middle of the vehicle and above the road, same shapes.
    """
    total = np.zeros_like(ahead_m, dtype=np.float32)
    for side in (-LAMP_SIDE_M, LAMP_SIDE_M):
        forward = np.maximum(ahead_m - LAMP_AHEAD_M, 0.2)
        turn = np.arctan2(left_m - side, forward)
        rise = np.arctan2(up_m - LAMP_UP_M, np.hypot(forward, left_m - side))
        cut = CUT_OFF_RAD + np.clip(-KINK * turn, 0, KINK_RAD)
        above = 1 / (1 + np.exp(-np.clip((cut - rise) / 0.004, -30, 30)))
        beam = np.exp(-0.5 * (turn / SPREAD_RAD) ** 2) * np.exp(-np.maximum(cut - rise, 0) / DROP_RAD)
        distance2 = forward**2 + (left_m - side) ** 2 + (up_m - LAMP_UP_M) ** 2
        total += ((STRAY + above * beam) * AXIS_M**2 / distance2).astype(np.float32)
    return np.minimum(total / 2 / AXIS, 6.0)


def _glow(light: Floats, pixel: np.ndarray, radius_px: float, share: float) -> None:
    """Add a lamp with its halo to ``light`` in place."""
    reach = int(min(6 * radius_px + 6, 60))
    u, v = round(float(pixel[0])), round(float(pixel[1]))
    rows = slice(max(v - reach, 0), max(v + reach + 1, 0))
    columns = slice(max(u - reach, 0), max(u + reach + 1, 0))
    part = light[rows, columns]
    if part.size:
        y, x = np.ogrid[: part.shape[0], : part.shape[1]]
        away2 = (columns.start + x - pixel[0]) ** 2 + (rows.start + y - pixel[1]) ** 2
        size2 = max(radius_px, 0.8) ** 2
        halo = share * (1.2 * np.exp(-away2 / size2) + 0.10 / (1 + away2 / (4 * size2)) ** 2)
        part += halo[:, :, None].astype(np.float32) * np.array(TAIL_BGR, np.float32)
