"""Side roads: straight arms at right angles to the carriageway, painted on the ground below it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim_harness.world.render.ground.markings import PAINT_BGR
from sim_harness.world.render.ground.strip_grid import edges_m
from sim_harness.world.render.ground.surface import EDGE_SOFTNESS_M, KERB_BGR, SURFACE_TINT
from sim_harness.world.roads.appearance import Paint
from sim_harness.world.roads.features import Junction, MouthLine, Side
from sim_harness.world.roads.road import Road
from trepid.types import Array, Image

UNDER_M = 1.0  # overlap of an arm with the carriageway
LINE_M, DASH_M, GAP_M = 0.12, 3.0, 3.0  # its centre line, short dashes as before junctions (RMS-1)
STOP_M, SET_BACK_M = 0.5, 1.0  # stop line, and its distance from the edge of the carriageway
TOOTH_M, TOOTH_GAP_M = 0.5, 0.25  # dashes of a line of waiting (RMS-1)
RIM_M = 0.1  # from the rim or its kerb to the edge line around a corner


@dataclass(frozen=True)
class Arm:
    """One side road: u runs along it from the reference line, v across it, along the main road."""

    junction: Junction
    origin_m: Array  # (x, y) on the reference line
    outwards: Array  # unit vector of u
    forwards: Array  # unit vector of v
    edge_m: float  # u where the carriageway ends
    bgr: Array

    @property
    def reach_m(self) -> float:
        return self.edge_m + self.junction.length_m


def arms_of(road: Road, tint: Array) -> Iterator[Arm]:
    for junction in road.settings.junctions:
        station = np.array([junction.at_m])
        right_m, left_m = (float(edge[0]) for edge in edges_m(road, station))
        section, heading = road.section_at(junction.at_m), road.heading_at(junction.at_m)
        surface = junction.surface or section.surface
        bgr = np.array(SURFACE_TINT[surface]) * tint * (255 * section.surface_grey)
        forwards = np.array([math.cos(heading), math.sin(heading)])
        leftwards = np.array([-forwards[1], forwards[0]])
        origin = np.array(road.position(junction.at_m, 0.0))
        for side, sign, edge in ((Side.LEFT, 1, left_m), (Side.RIGHT, -1, right_m)):
            if junction.side in (side, Side.BOTH):
                yield Arm(junction, origin, sign * leftwards, forwards, edge, bgr)


def lay_arm(tile: Image, arm: Arm, x_m: Array, y_m: Array, grain: Image) -> None:
    """Paint an arm onto a tile whose columns lie at ``x_m`` and rows at ``y_m``; ``grain`` varies around 128."""
    pixel_m = float(x_m[1] - x_m[0])
    columns, rows = _window(arm, x_m, 0), _window(arm, y_m, 1)
    if columns is None or rows is None:
        return
    x, y = x_m[columns][None, :] - arm.origin_m[0], y_m[rows][:, None] - arm.origin_m[1]
    u = x * arm.outwards[0] + y * arm.outwards[1]
    v = x * arm.forwards[0] + y * arm.forwards[1]
    cover = _cover(_inside(arm, u, v), max(EDGE_SOFTNESS_M, pixel_m))
    tone = 0.4 + 0.6 * grain[rows, columns].astype(np.float64) / 128
    colour = arm.bgr * tone.mean(axis=2, keepdims=True)
    for share, bgr in _paint_layers(arm, u, v, pixel_m):
        colour = colour + share[:, :, None] * (np.array(bgr) - colour)
    bare = tile[rows, columns].astype(np.float64)
    tile[rows, columns] = np.clip(bare + cover[:, :, None] * (colour - bare), 0, 255)


def _window(arm: Arm, places_m: Array, axis: int) -> slice | None:
    """The range of a tile's columns (axis 0) or rows (axis 1) that an arm may touch."""
    wide_m = arm.junction.width_m / 2 + arm.junction.radius_m + 1
    ends = arm.origin_m[axis] + arm.outwards[axis] * np.array([0.0, arm.reach_m])
    near = np.flatnonzero((places_m > ends.min() - wide_m) & (places_m < ends.max() + wide_m))
    return slice(int(near[0]), int(near[-1]) + 1) if len(near) else None


def _inside(arm: Arm, u: Array, v: Array) -> Array:
    """Distance [m] from the rim of an arm, positive inside; its corners are rounded with the junction's radius."""
    radius_m = arm.junction.radius_m
    to_round = np.clip(arm.edge_m + radius_m - u, 0, radius_m)
    half_m = arm.junction.width_m / 2 + radius_m - np.sqrt(radius_m**2 - to_round**2)
    along = np.minimum(u - arm.edge_m + UNDER_M, arm.reach_m - u)
    return np.minimum(half_m - np.abs(v), along)


def _from_rim(arm: Arm, u: Array, v: Array) -> Array:
    """Distance [m] from the sides and the rounded corners of an arm, perpendicular to them, positive inside."""
    radius_m, half_m = arm.junction.radius_m, arm.junction.width_m / 2
    to_centre_m = arm.edge_m + radius_m - u
    round_m = np.hypot(to_centre_m, half_m + radius_m - np.abs(v)) - radius_m
    return np.where(to_centre_m > 0, round_m, half_m - np.abs(v))


def _paint_layers(
    arm: Arm, u: Array, v: Array, pixel_m: float
) -> Iterator[tuple[Array, tuple[int, int, int]]]:
    """Shares of paint and kerb, and their colours, in the order in which they are laid."""
    junction, white = arm.junction, PAINT_BGR[Paint.WHITE]
    beyond = _cover(u - arm.edge_m, pixel_m)  # the carriageway of the main road covers the rest
    rim_m = _from_rim(arm, u, v)
    if junction.kerb_m:
        yield _cover(junction.kerb_m / 2 - np.abs(rim_m - junction.kerb_m / 2), pixel_m) * beyond, KERB_BGR
    if junction.rim_line:
        middle_m = junction.kerb_m + RIM_M + LINE_M / 2
        yield _cover(LINE_M / 2 - np.abs(rim_m - middle_m), pixel_m) * beyond, white
    run = u - arm.edge_m - SET_BACK_M
    if junction.centre_line:
        dash = _cover(DASH_M / 2 - np.abs((run - STOP_M) % (DASH_M + GAP_M) - DASH_M / 2), pixel_m)
        yield _cover(LINE_M / 2 - np.abs(v), pixel_m) * dash * (run > STOP_M), white
    if junction.line is not MouthLine.NONE:
        across = v * (arm.outwards[1] * arm.forwards[0] - arm.outwards[0] * arm.forwards[1])
        half = (across > 0) if junction.left_hand else (across < 0)
        half = half & (np.abs(v) < junction.width_m / 2)
        bar = _cover(STOP_M / 2 - np.abs(run - STOP_M / 2), pixel_m) * half
        if junction.line is MouthLine.GIVE_WAY:
            bar = bar * _cover(TOOTH_M / 2 - np.abs(v % (TOOTH_M + TOOTH_GAP_M) - TOOTH_M / 2), pixel_m)
        yield bar, white


def _cover(inside_m: Array, soft_m: float) -> Array:
    """Share of a pixel that lies inside, from its distance to the rim."""
    return np.asarray(np.clip(inside_m / soft_m + 0.5, 0, 1), np.float64)
