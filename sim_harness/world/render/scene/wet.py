"""Reflections of sky, hills and vehicles on a wet carriageway, weighted by the Fresnel equations."""

import math

import cv2
import numpy as np

from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.render.scene.backdrop import MIRROR_MARGIN_PX, Backdrop
from sim_harness.world.render.scene.painter import SHIFT, Pixels
from sim_harness.world.render.scene.relief import camera_at
from sim_harness.world.render.scene.vehicles import draw_lead
from sim_harness.world.render.scene.view import AHEAD_M, Shot, View, in_colour, light_of, polygon
from trepid.types import Floats

PUDDLE_PX, PUDDLE_M = 256, 0.2  # period and pixel size of the pattern of puddles
ROUGH_PX = (0.006, 0.035)  # blur across and along, in focal lengths: wet asphalt is rough


class WetRoad:
    def __init__(self, view: View, backdrop: Backdrop, *, seed: int) -> None:
        self._view = view
        self._backdrop = backdrop
        rng = np.random.default_rng((seed, 21))
        shape = (PUDDLE_PX, PUDDLE_PX)
        noise = smooth_noise(rng, shape, (16, 16)) + 0.6 * smooth_noise(rng, shape, (4, 4))
        self._puddles = np.asarray(np.clip(128 + 60 * noise, 0, 255), np.uint8)
        self._road_from_pixel = np.linalg.inv(view.camera.pixel_from_road_matrix)
        self._ground = (view.rays[2] < -0.02).astype(np.float32)

    def mirror(self, light: Floats, shot: Shot, wet: float) -> Floats:
        """``light`` with the reflections of a road of wetness ``wet`` (0..1), in place."""
        share = self._view.fresnel * self._shine(shot, wet)
        mirrored = self._backdrop.mirror_image(shot.pose[2])
        for pose, body in shot.vehicles:
            camera = camera_at(self._view.camera, shot.relief, *pose[:2])
            draw_lead(mirrored, camera, body, pose, mirrored=True)
        size = self._view.camera.fy_px
        rows = slice(max(self._backdrop.rows - MIRROR_MARGIN_PX, 0), None)
        reflected, blur_px = light_of(mirrored[rows]), (ROUGH_PX[0] * size, ROUGH_PX[1] * size)
        soft = cv2.GaussianBlur(reflected, (0, 0), blur_px[0], sigmaY=blur_px[1])
        below = light[rows]
        light[rows] = below + cv2.multiply(cv2.subtract(soft, below), in_colour(share[rows]))
        return light

    def _shine(self, shot: Shot, wet: float) -> Floats:
        """Reflectance of each pixel of the carriageway relative to still water, (rows, columns)."""
        mask = np.zeros(self._ground.shape, np.uint8)
        outline = carriageway(self._view, shot)
        if outline is not None:
            cv2.fillPoly(mask, [outline], 255, cv2.LINE_AA, SHIFT)
        x, y, yaw = shot.pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        world = np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1.0]])
        pattern = np.diag([1 / PUDDLE_M, 1 / PUDDLE_M, 1]) @ world @ self._road_from_pixel
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = mask.shape[::-1]
        puddles = cv2.warpPerspective(self._puddles, pattern, size, flags=flags, borderMode=cv2.BORDER_WRAP)
        film = np.clip(wet * (0.25 + 1.1 * puddles.astype(np.float32) / 255), 0, 1)
        return np.asarray(film * mask * self._ground / np.float32(255), np.float32)


def carriageway(view: View, shot: Shot, *, inset_m: float = 0.0) -> Pixels | None:
    """Fixed-point outline of the carriageway ahead in the image; None when it is out of view."""
    camera, section = view.camera, shot.road.section_at(shot.station_m)
    half = shot.road.width_at(shot.station_m) / 2
    sides = []
    left = (1, section.lanes_to_the_left, section.paved_left_m)
    right = (-1, section.right_lanes, section.paved_right_m)
    for sign, lanes, paved in (left, right):
        widths = (2 * half if lane.width_m is None else float(np.max(lane.width_m)) for lane in lanes)
        across = half + paved - inset_m + sum(widths)
        points = shot.along(sign * across, AHEAD_M)
        pixels = camera.pixel_from_road(points)
        if shot.relief is not None:
            lift_m = [shot.relief.lift_at(*point) for point in points]
            pixels = view.pixels(np.column_stack([points, lift_m]))[0]
        sides.append(pixels[(points[:, 0] > camera.x_m + 0.4) & np.isfinite(pixels).all(axis=1)])
    outline = np.concatenate([sides[0], sides[1][::-1]])
    return polygon(outline) if len(outline) > 3 else None
