"""Renders camera frames of a road.

Flat ground is an image from above, warped by the camera's homography; a road with heights is drawn by
:mod:`sim_harness.world.render.relief_ground`. The image is split into bands
of distance. Each band reads the level of the ground with pixels of about its own width, and averages several drawn
rows where one row of the image spans many pixels of the ground (anti-aliasing). The frame has four channels until
the ground is drawn, because OpenCV warps four channels twice as fast as three.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.plants.springs import LEVEL, Attitude
from sim_harness.world.render.disturber import Disturber, Grade
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.ground.strip_grid import LEVELS_M
from sim_harness.world.render.optics.exposure import Exposure
from sim_harness.world.render.optics.lens import Distortion
from sim_harness.world.render.optics.sway import Sway
from sim_harness.world.render.relief_ground import HAZE_REACH_M, average_rows, draw_relief, relief_distance
from sim_harness.world.render.scene.backdrop import Backdrop
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.relief import BankedRelief, Relief, behind, camera_at
from sim_harness.world.render.scene.things import Thing, draw_thing
from sim_harness.world.render.scene.vehicles import Body, Upright, draw_lead
from sim_harness.world.render.scene.view import STILL, Shot, ShutterMotion, View
from sim_harness.world.render.scene.walls import Walls
from sim_harness.world.roads.appearance import Light
from sim_harness.world.roads.disturbances import Disturbance, disturb
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.scale import scaled_message, scaled_settings
from trepid.types import Array, Floats, Image

REACH = ((0, 0.9), (0, 1.2), (1, 1.2), (2, 1.2), (3, 1.2), (4, math.inf))
"""Bands from near to far: level, and reach as the ratio of image pixel to level pixel on the ground."""
MAX_ROWS_PER_ROW = 6
PAINT_AHEAD_M = 7.0  # distance at which tiles are painted in advance, one a frame
LIGHT_RAMP_M = 10.0  # over which the light changes between sections
LEAD = Body()
THINGS_WITHIN_M = 80.0  # distance within which things beside the road are drawn

T = TypeVar("T", Upright, Thing)


@dataclass(frozen=True, slots=True)
class Band:
    """Rows ``top`` to ``bottom`` of the image, drawn from one level of the ground."""

    top: int
    bottom: int
    level: int
    rows_per_row: int
    road_from_pixel: Array  # from pixels of the drawn band to homogeneous road points
    corners_m: Array  # of the ground it shows, road frame, (4, 2)


class Renderer:
    """Renders frames of one road for one camera. Equal seed, pose and time give equal bytes."""

    def __init__(
        self,
        road: Road,
        camera: Camera,
        *,
        seed: int,
        ground: Ground | None = None,
        disturbances: Sequence[Disturbance] = (),
        things: Sequence[tuple[Pose, Thing]] = (),
        on_springs: bool = False,
    ) -> None:
        """``ground``: shared between the cameras of one road, enlarged to the reference world of
        :mod:`trepid.scale`; disturbances do not repaint it. ``things``: beside the road, with their poses.
        ``on_springs``: the camera is turned by the attitude of each frame, as on a road with speed humps.

        Raises ValueError for a distortion that is not one-to-one, InputError for a bad table of disturbances.
        """
        self.road, self.camera, self.seed = road, camera, seed
        self._enlargement = 1 / road.settings.scale  # of the drawn road and camera
        road, camera = road.in_reference_world, scaled_settings(camera, self._enlargement)
        disturbances = [scaled_settings(d, self._enlargement) for d in disturbances]
        if ground is None and disturbances:
            road = Road(disturb(road.settings, disturbances))
        self._world = road
        self._lens = Distortion(camera) if any(camera.distortion) else None
        self._eye = self._lens.pinhole if self._lens else camera
        self._sway = Sway(self._eye) if on_springs or road.settings.humps else None
        self._eye = self._sway.eye if self._sway else self._eye
        self._ground = ground or Ground(road, seed=seed)
        self._backdrop = Backdrop(self._eye, seed=seed)
        self._things = _enlarge_poses(things, self._enlargement)
        self._walls = Walls(road, seed=seed) if road.settings.walls else None
        self._view = (
            View(self._eye) if self._walls or not road.flat else None
        )  # of what rises above the plane
        self._exposure = Exposure(camera)
        self._bands = _bands(self._eye, self._backdrop.rows)
        self._corners_m = np.array([band.corners_m for band in self._bands]).reshape(-1, 4, 2)
        self._far_rows, self._far_share = _far(self._eye, self._backdrop.rows)
        self._hazy_from_m = float(_depth(self._eye, np.array([float(self._far_rows.stop)]))[0])
        self._disturber = None
        if any(disturbance.grade > 0 for disturbance in disturbances):
            self._disturber = Disturber(road, self._eye, camera, self._backdrop, disturbances, seed=seed)
        self._far_haze = np.empty((self._eye.height_px, self._eye.width_px, 4), np.uint8)
        self._far_haze[:] = (*np.rint(self._backdrop.horizon_bgr), 255)

    def render(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        *,
        t_s: float,
        station_m: float | None = None,
        lead: Pose | None = None,
        vehicles: Sequence[tuple[Pose, Upright]] = (),
        motion: ShutterMotion = STILL,
        light: Light | None = None,
        attitude: Attitude = LEVEL,
    ) -> Image:
        """The frame of a vehicle with its rear axle at (x, y, yaw).

        ``station_m``: its station, if known; ``lead``: x, y, yaw of the rear axle of the vehicle ahead;
        ``vehicles``: poses and bodies of others, people and animals included; ``motion``: of the own vehicle, for
        motion blur and rolling shutter; ``light``: replaces that of the road's section; ``attitude``: of the body,
        for a camera on springs.
        """
        larger = self._enlargement
        x_m, y_m, motion = x_m * larger, y_m * larger, scaled_message(motion, larger)
        station_m = station_m if station_m is None else station_m * larger
        if station_m is None and (light is None or self._disturber or not self._world.flat):
            station_m = self._world.local_coordinates(x_m, y_m)[0]
        pose = (x_m, y_m, yaw_rad)
        others: list[tuple[Pose, Upright]] = [*vehicles, *([] if lead is None else [(lead, LEAD)])]
        near = [one for one in self._things if math.dist(one[0][:2], pose[:2]) < THINGS_WITHIN_M]
        hides = bool(others or near or self._walls or self._disturber)
        image, relief, surface_m = self._ground_and_sky(pose, station_m, hides=hides)
        for place, thing in _far_first(near, pose):
            with behind(image, surface_m, _distance((place, thing))):
                draw_thing(image, camera_at(self._eye, relief, *place[:2]), thing, place)
        self._paint_ahead(x_m, y_m, yaw_rad)
        shot = Shot(
            road=self._world,
            pose=pose,
            station_m=0.0 if station_m is None else station_m,
            t_s=t_s,
            motion=motion,
            vehicles=_far_first(_enlarge_poses(others, larger), pose),
            sun_bearing_rad=self._world.settings.sun_azimuth_rad - yaw_rad - self.camera.yaw_rad,
            seed=self.seed,
            relief=relief,
            surface_m=surface_m,
            attitude=attitude,
        )
        light = self._light_at(shot.station_m) if light is None else light
        grades = self._disturber.grades(shot.station_m) if self._disturber else {}
        if self._disturber and (grades or self._disturber.needs_light(shot.station_m, grades)):
            return self._disturb(self._disturber, image, shot, light, grades)
        self._draw(shot.vehicles, image, shot)
        return self._expose(np.asarray(self._bend(image, shot), np.uint8), shot, light)

    def _ground_and_sky(
        self, pose: Pose, station_m: float | None, *, hides: bool
    ) -> tuple[Image, Relief | None, Floats | None]:
        """Ground, sky and walls; the relief; where ground ``hides`` things, distance of ground and walls."""
        padded = np.empty((self._eye.height_px, self._eye.width_px, 4), np.uint8)
        relief, surface_m = None, None
        if self._view is not None and not self._world.flat and station_m is not None:
            shape = Relief if self._world.bank is None else BankedRelief
            relief = shape(self._world, self._eye, station_m, pose)
            sky_rows = max(math.ceil(float(relief.tops.max())) + 1, 0)
            self._backdrop.draw_from(padded[:sky_rows], pose[2], relief.horizon_row)
            haze, from_m = self._far_haze, self._hazy_from_m
            draw_relief(padded, self._ground, self._view, relief, haze, hazy_from_m=from_m)
            surface_m = relief_distance(self._view, relief) if hides else None
        else:
            self._backdrop.draw(padded, pose[2])
            self._draw_ground(padded, *pose)
        image = np.asarray(cv2.cvtColor(padded, cv2.COLOR_BGRA2BGR), np.uint8)
        if self._view is not None and self._walls is not None:
            surface_m = self._view.distance_m.copy() if surface_m is None else surface_m
            self._walls.draw(image, surface_m, self._view, pose, relief)
        return image, relief, surface_m

    def _draw(self, vehicles: Sequence[tuple[Pose, Upright]], image: Image, shot: Shot) -> None:
        for pose, body in vehicles:
            with behind(image, shot.surface_m, _distance((pose, body))):
                draw_lead(image, camera_at(self._eye, shot.relief, *pose[:2]), body, pose)

    def _bend(self, image: NDArray[Any], shot: Shot) -> NDArray[Any]:
        image = self._sway.turn(image, shot.attitude) if self._sway else image
        return self._lens.bend(image) if self._lens else image

    def _expose(self, image: Image, shot: Shot, light: Light, *, vignetted: bool = False) -> Image:
        bearing, noise = shot.sun_bearing_rad, (self.seed, shot.frame)
        return self._exposure.expose(image, light, sun_bearing_rad=bearing, seed=noise, vignetted=vignetted)

    def _disturb(self, disturber: Disturber, image: Image, shot: Shot, light: Light, grades: Grade) -> Image:
        """The frame from ``image`` (ground and sky) under the disturbances ``grades``."""
        still = _far_first(disturber.standing_near(shot.pose), shot.pose)
        self._draw(still, image, shot)
        image = disturber.move(image, shot, grades)
        # Vehicles drawn from here on stay sharp: their speed is close to that of the own vehicle.
        self._draw(shot.vehicles, image, shot)
        shot = replace(shot, vehicles=tuple(sorted((*still, *shot.vehicles), key=_distance, reverse=True)))
        with_light = disturber.needs_light(shot.station_m, grades)
        if with_light:
            scene = disturber.scene(image, shot, grades)
            scene = np.asarray(self._bend(scene, shot), np.float32)
            scene = disturber.through_lens(scene, shot, grades, self._exposure.vignette)
            image = disturber.develop(scene, shot, grades)
        else:
            image = np.asarray(self._bend(image, shot), np.uint8)
        return disturber.finish(self._expose(image, shot, light, vignetted=with_light), shot, grades)

    def prepaint(self) -> None:
        """Paint the whole carriageway and its surroundings now, so that no later frame waits for it."""
        self._ground.prepaint()

    def _draw_ground(self, image: Image, x_m: float, y_m: float, yaw_rad: float) -> None:
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        world_from_road = np.array([[cos, -sin, x_m], [sin, cos, y_m], [0, 0, 1.0]])
        for band, low, high in zip(self._bands, *self._footprints(x_m, y_m, yaw_rad), strict=True):
            pixel_m = LEVELS_M[band.level]
            crop, x0, y0 = self._ground.crop(band.level, low - 2 * pixel_m, high + 2 * pixel_m)
            crop_from_world = np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, pixel_m]]) / pixel_m
            matrix = crop_from_world @ world_from_road @ band.road_from_pixel
            size = (image.shape[1], (band.bottom - band.top) * band.rows_per_row)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            drawn = cv2.warpPerspective(crop, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            image[band.top : band.bottom] = average_rows(np.asarray(drawn, np.uint8), band.rows_per_row)
        far = image[self._far_rows]
        if len(far):
            far[:] = cv2.blendLinear(far, self._far_haze[: len(far)], 1 - self._far_share, self._far_share)

    def _paint_ahead(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Paint at most one tile of the ground ahead, so that no frame has to paint many."""
        x_m, y_m = x_m + PAINT_AHEAD_M * math.cos(yaw_rad), y_m + PAINT_AHEAD_M * math.sin(yaw_rad)
        lows, highs = self._footprints(x_m, y_m, yaw_rad)
        for band, low, high in zip(self._bands[:3], lows, highs, strict=False):
            if self._ground.paint_one(band.level, low, high):
                return

    def _footprints(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[Array, Array]:
        """Minimum and maximum x and y of the ground in each band, (bands, 2) each."""
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        corners = self._corners_m @ np.array([[cos, sin], [-sin, cos]]) + (x_m, y_m)
        return corners.min(axis=1), corners.max(axis=1)

    def _light_at(self, station_m: float) -> Light:
        before, here, share = self._world.transition_at(station_m, LIGHT_RAMP_M)
        if share == 1 or before.light == here.light:
            return here.light
        fields = Light.model_fields
        blend = {n: (1 - share) * getattr(before.light, n) + share * getattr(here.light, n) for n in fields}
        return Light(**blend)


def _enlarge_poses(placed: Sequence[tuple[Pose, T]], larger: float) -> list[tuple[Pose, T]]:
    return [((x * larger, y * larger, yaw), scaled_message(one, larger)) for (x, y, yaw), one in placed]


def _far_first(placed: Sequence[tuple[Pose, T]], origin: Pose) -> tuple[tuple[Pose, T], ...]:
    """``placed`` relative to ``origin``, the farthest first."""
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    relative = []
    for (x_m, y_m, yaw_rad), one in placed:
        dx, dy = x_m - origin[0], y_m - origin[1]
        relative.append(((cos * dx + sin * dy, cos * dy - sin * dx, yaw_rad - origin[2]), one))
    return tuple(sorted(relative, key=_distance, reverse=True))


def _distance(placed: tuple[Pose, T]) -> float:
    (x_m, y_m, _), _ = placed
    return math.hypot(x_m, y_m)


def _bands(camera: Camera, first_row: int) -> list[Band]:
    """The image below the horizon, from the bottom up."""
    bands, bottom = [], camera.height_px
    for level, reach in REACH:
        reach_m = reach * LEVELS_M[level] * camera.fx_px
        # The first row with a depth of at most reach_m: depth = height / tan of the row's angle.
        row = math.ceil(camera.horizon_row_px + camera.fy_px * camera.height_m / reach_m)
        top = max(first_row, row)
        if top < bottom:
            bands.append(_band(camera, top, bottom, level))
            bottom = top
    return bands


def _band(camera: Camera, top: int, bottom: int, level: int) -> Band:
    depths = _depth(camera, np.array([top, top + 1.0]))
    repeat = int(np.clip(round((depths[0] - depths[1]) / (3 * LEVELS_M[level])), 1, MAX_ROWS_PER_ROW))
    image_from_drawn = np.array([[1, 0, 0], [0, 1 / repeat, top + 0.5 / repeat - 0.5], [0, 0, 1]])
    right, low = camera.width_px - 1, bottom - 0.5
    corners = camera.road_from_pixel([(0, top - 0.5), (right, top - 0.5), (right, low), (0, low)])
    road_from_drawn = np.linalg.inv(camera.pixel_from_road_matrix) @ image_from_drawn
    return Band(top, bottom, level, repeat, road_from_drawn, corners)


def _depth(camera: Camera, row: Array) -> Array:
    """Distance of the ground in each row [m]."""
    pixels = np.column_stack([np.full(len(row), camera.cx_px), row])
    return np.hypot(*(camera.road_from_pixel(pixels) - (camera.x_m, camera.y_m)).T)


def _far(camera: Camera, first_row: int) -> tuple[slice, Floats]:
    """The rows below the horizon that fade into haze, and the share of haze in each pixel, (rows, columns)."""
    last = min(first_row + 24, camera.height_px)
    share = 1 - np.exp(-_depth(camera, np.arange(first_row, last, dtype=float)) / HAZE_REACH_M)
    return slice(first_row, last), np.repeat(share[:, None].astype(np.float32), camera.width_px, axis=1)
