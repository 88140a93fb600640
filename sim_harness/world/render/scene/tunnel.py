"""A tunnel: dark walls with lamps, a bright exit, and an automatic exposure with delay.

The tube is drawn as rings of its cross-section from near to far; inside the last ring the image is unchanged.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import SHIFT, Pixels
from sim_harness.world.render.scene.vehicles import outline
from sim_harness.world.render.scene.view import Shot, View, in_colour, polygon
from sim_harness.world.render.scene.wet import carriageway
from sim_harness.world.roads.disturbance_table import TunnelExit, at
from sim_harness.world.roads.disturbances import Disturbance
from trepid.types import Array, Floats, Mask

LENGTH_M = 80.0  # of a tunnel without an end
HALF_M, WALL_M, CROWN_M = 5.2, 3.4, 5.6  # half width, straight wall, crown
DRAWN_WITHIN_M = 150.0  # distance of the entry
WALL_LIGHT = 0.28  # of the wall in the tunnel's own light, relative to white
MOUTH_REACH_M = 4.5  # decay length of the daylight inside
LAMP_EVERY_M, LAMP_M = 12.0, 2.0
RING_SHARE = 0.10  # distance between rings relative to that from the camera
FALLEN_IN = 0.6  # share of the daylight that reaches the floor of the mouth
FACADE_LIGHT, FOOTWAY_LIGHT = 0.30, 0.16
WALL_BGR = (0.80, 0.94, 1.0)
UNTOUCHED = -1.0
BACK_OFF_M = 8.0  # over which the exposure opens after the entry
# Cross-sections (offset, height) from the left to the right, of the portal and of the tube.
FACADE = np.array([(30.0, 0.0), (16.0, 9.0), (-16.0, 9.0), (-30.0, 0.0)])
TURN = np.linspace(0, math.pi, 13)
CROWN = np.column_stack([HALF_M * np.cos(TURN), WALL_M + (CROWN_M - WALL_M) * np.sin(TURN)])
ARCH = np.vstack([[HALF_M, 0.0], CROWN, [-HALF_M, 0.0]])


def extent(disturbance: Disturbance) -> tuple[float, float]:
    """Stations of entry and exit."""
    end_m = disturbance.from_m + LENGTH_M if disturbance.to_m is None else disturbance.to_m
    return disturbance.from_m, end_m


def exposure_stops(disturbance: Disturbance, station_m: float, settings: TunnelExit) -> float:
    """Stops by which the automatic exposure is open: it opens inside and closes behind the exit."""
    start_m, end_m = extent(disturbance)
    full = at(settings.stops, disturbance.grade)
    if station_m < start_m:
        return 0.0
    opened = full * (1 - math.exp(-(min(station_m, end_m) - start_m) / BACK_OFF_M)) if start_m > 0 else full
    late_m = max(station_m - end_m, 0.0)
    return opened * math.exp(-late_m / at(settings.adapts_over_m, disturbance.grade))


def in_tunnel(
    light: Floats, view: View, shot: Shot, disturbance: Disturbance, settings: TunnelExit
) -> Floats:
    start_m, end_m = extent(disturbance)
    station_m = shot.station_m + view.camera.x_m
    if station_m >= end_m or start_m - station_m > DRAWN_WITHIN_M:
        return light
    inside = at(settings.inside, disturbance.grade)
    first_m = max(start_m, station_m + 0.8)
    last_m = min(end_m, station_m + DRAWN_WITHIN_M)
    walls = np.full(light.shape[:2], UNTOUCHED, np.float32)
    if start_m > station_m:
        for facade in _outlines(view, shot, [start_m], FACADE):
            cv2.fillPoly(walls, [facade], FACADE_LIGHT, cv2.LINE_8, SHIFT)
    else:
        walls[:] = _wall(station_m, end_m, inside)
    rings_m = _rings(first_m, last_m, station_m)
    arches = _outlines(view, shot, rings_m, ARCH)
    for ring_m, arch in zip(rings_m[-len(arches) :], arches, strict=False):
        here = UNTOUCHED if ring_m == end_m else _wall(ring_m, end_m, inside)
        cv2.fillConvexPoly(walls, arch, here, cv2.LINE_8, SHIFT)
    floor = _floor(view, shot, first_m, last_m, whole=start_m <= station_m) & (view.rays[2] < 0)
    return _lit(light, view, shot, walls, floor, mouth_m=end_m - station_m, inside=inside)


def _lit(
    light: Floats, view: View, shot: Shot, walls: Floats, floor: Mask, *, mouth_m: float, inside: float
) -> Floats:
    """``light`` with the walls, and with floor and vehicles in the light of the tunnel."""
    fallen_in = FALLEN_IN * (1 - inside) * np.exp(-np.maximum(mouth_m - view.distance_m, 0) / MOUTH_REACH_M)
    shade = np.where(floor & (view.distance_m < mouth_m), inside + fallen_in, 1).astype(np.float32)
    wall = (walls != UNTOUCHED) & ~floor
    for pose, body in shot.vehicles:
        reach_m = pose[0] + body.rear_m
        shape = outline(view.camera, body, pose)
        if shape is not None and reach_m < mouth_m:
            there = np.zeros(wall.shape, np.uint8)
            cv2.fillConvexPoly(there, shape, 1, cv2.LINE_8, SHIFT)
            wall &= there == 0
            daylight = math.exp((reach_m - mouth_m) / MOUTH_REACH_M)
            shade[there > 0] = inside + FALLEN_IN * (1 - inside) * daylight
    road = np.zeros(wall.shape, np.uint8)
    edges = carriageway(view, shot, inset_m=0.2)
    if edges is not None:
        cv2.fillPoly(road, [edges], 1, cv2.LINE_8, SHIFT)
    out = light.copy()
    out[floor & (road == 0) & (view.distance_m < mouth_m)] = FOOTWAY_LIGHT
    out *= in_colour(shade)
    out[wall] = walls[wall][:, None] * np.array(WALL_BGR, np.float32)
    return np.asarray(out, np.float32)


def _rings(first_m: float, last_m: float, eye_m: float) -> list[float]:
    """Stations of cross-sections, denser near the camera."""
    rings = [first_m]
    while rings[-1] < last_m:
        rings.append(rings[-1] + max(RING_SHARE * (rings[-1] - eye_m), 0.15))
    return [*rings[:-1], last_m]


def _wall(station_m: float, end_m: float, inside: float) -> float:
    lamp = 2.2 if station_m % LAMP_EVERY_M < LAMP_M else 1.0
    mouth = 0.5 * (1 - inside) * math.exp(-max(end_m - station_m, 0.0) / MOUTH_REACH_M)
    return WALL_LIGHT * (inside * lamp + mouth)


def _outlines(view: View, shot: Shot, stations_m: Sequence[float], section: Array) -> list[Pixels]:
    """Fixed-point outlines of a cross-section at rising stations, from the first station ahead on."""
    count, corners = len(stations_m), len(section)
    across = shot.road.positions(np.repeat(stations_m, corners), np.tile(section[:, 0], count))
    points = np.column_stack([shot.from_world(across), np.tile(section[:, 1], count)])
    pixels, depth = view.pixels(points)
    ahead = depth.reshape(count, corners).min(axis=1) > 0.3
    first = int(np.argmax(ahead)) if ahead.any() else count
    last = first + int(np.argmin(np.append(ahead[first:], False)))
    return list(polygon(pixels).reshape(count, corners, 2)[first:last])


def _floor(view: View, shot: Shot, from_m: float, to_m: float, *, whole: bool) -> Mask:
    ahead = np.linspace(from_m, to_m, 40) - shot.station_m
    sides = [view.camera.pixel_from_road(shot.along(sign * HALF_M, ahead)) for sign in (1, -1)]
    edges = np.concatenate([sides[0], sides[1][::-1]])
    edges = edges[np.isfinite(edges).all(axis=1)]
    mask = np.zeros(view.distance_m.shape, np.uint8)
    if len(edges) < 3:
        return mask > 0
    if whole:  # the tube extends below the image
        (left, _), (right, _) = edges[0], edges[-1]
        low = 4.0 * len(mask)
        edges = np.vstack([(left + 4 * (left - right), low), edges, (right - 4 * (left - right), low)])
    cv2.fillPoly(mask, [polygon(edges)], 1, cv2.LINE_8, SHIFT)
    return mask > 0
