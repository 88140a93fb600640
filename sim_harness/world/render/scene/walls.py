"""What stands along a road: parapets, garden walls, hedges, houses, kerbs, banks of snow, trees.

Only the face towards the road is drawn. A tree looks alike from all sides: its trunk is a strip and its crown an
ellipse across the line of sight.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import NEAR_M, SHIFT, Pixels, Pose
from sim_harness.world.render.scene.relief import SLACK_M, Relief
from sim_harness.world.render.scene.view import View, polygon
from sim_harness.world.roads.features import TRUNK_M, Wall, WallKind
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats, Image

PANEL_M = {
    WallKind.PARAPET: 2.0,
    WallKind.STONE: 2.0,
    WallKind.HEDGE: 1.0,
    WallKind.HOUSES: 3.0,
    WallKind.KERB: 1.0,
    WallKind.SNOW: 0.5,
}
WITHIN_M = 160.0  # distance within which walls are drawn
FRONT_PANELS = 3  # panels of one house
# Bands from the ground up: upper end as a share of the height, and colour; each panel varies it.
BANDS = {
    WallKind.PARAPET: ((0.85, (150, 156, 158)), (1.0, (178, 184, 186))),
    WallKind.STONE: (
        (0.3, (86, 98, 108)),
        (0.62, (104, 116, 126)),
        (0.93, (92, 106, 118)),
        (1.0, (142, 150, 154)),
    ),
    WallKind.HEDGE: ((0.3, (28, 48, 36)), (0.75, (38, 74, 52)), (1.0, (52, 98, 70))),
    WallKind.HOUSES: ((0.08, (96, 100, 104)), (0.94, (150, 165, 175)), (1.0, (60, 70, 96))),
    WallKind.KERB: ((0.75, (122, 128, 130)), (1.0, (168, 172, 174))),
    WallKind.SNOW: ((0.2, (150, 152, 152)), (0.6, (206, 206, 204)), (1.0, (236, 234, 230))),
    WallKind.TREES: ((1.0, (40, 52, 62)), (1.0, (40, 78, 56))),  # trunk; crown
}
VARIES = {
    WallKind.PARAPET: 0.05,
    WallKind.STONE: 0.14,
    WallKind.HEDGE: 0.18,
    WallKind.HOUSES: 0.10,
    WallKind.KERB: 0.06,
    WallKind.SNOW: 0.04,
    WallKind.TREES: 0.2,
}
RAGGED = {WallKind.HEDGE: 0.07, WallKind.SNOW: 0.07, WallKind.TREES: 0.15}
"""Standard deviation of the height, as a share."""
CROWN = (0.28, 0.2)  # lower end and half of the width of a crown, as shares of the height
CROWN_CORNERS = 14
TRUNK_CORNERS = ((-1, 0.0), (1, 0.0), (1, 0.5), (-1, 0.5))  # side, share of the height
GLASS_BGR, WINDOW_M, STOREY_M = (70, 62, 52), (1.1, 1.4), 3.0  # of houses
SILL_M = 1.0


@dataclass(frozen=True, slots=True)
class _Panels:
    """The panels of one wall on one side."""

    kind: WallKind
    ends_m: Array  # in plan, (n, 2 ends, 2); of a tree both are its middle
    tall_m: Array  # (n,)
    tints: Array  # (n, bands)


class Walls:
    """All walls of one road. Equal seeds give equal walls."""

    def __init__(self, road: Road, *, seed: int) -> None:
        self._panels = [
            _panels(road, wall, sign, np.random.default_rng((seed, 61, number, sign + 1)))
            for number, wall in enumerate(road.settings.walls)
            for sign in wall.signs
        ]

    def draw(self, image: Image, surface_m: Floats, view: View, pose: Pose, relief: Relief | None) -> None:
        """Draw them into ``image``, and their distance from the lens into ``surface_m``.

        ``surface_m``: distance of the ground along each ray, which hides walls behind a crest.
        """
        drawn, wall_m = image.copy(), np.full(surface_m.shape, np.inf, np.float32)
        faces = [face for panels in self._panels for face in _faces(panels, view, pose, relief)]
        for reach_m, outlines, fills in sorted(faces, key=lambda face: -face[0]):
            for corners, bgr in fills:
                cv2.fillConvexPoly(drawn, corners, bgr, cv2.LINE_AA, SHIFT)
            for outline in outlines:
                cv2.fillConvexPoly(wall_m, outline, reach_m, cv2.LINE_8, SHIFT)
        seen = wall_m < surface_m + SLACK_M
        if relief is None:
            image[:] = drawn
        else:
            image[seen] = drawn[seen]
        surface_m[seen] = wall_m[seen]


def _panels(road: Road, wall: Wall, sign: int, rng: np.random.Generator) -> _Panels:
    if wall.kind is WallKind.TREES:
        stations, starts, ends = wall.trunks_m, slice(None), slice(None)
    else:
        pieces = max(round((wall.to_m - wall.from_m) / PANEL_M[wall.kind]), 1)
        stations = np.linspace(wall.from_m, wall.to_m, pieces + 1)
        starts, ends = slice(None, -1), slice(1, None)
    places = road.positions(stations, wall.aside_m(road.widths_at(stations), sign))
    ends_m = np.stack([places[starts], places[ends]], axis=1)
    count = len(ends_m)
    tall = np.full(count, wall.tall_m)
    if wall.kind in RAGGED:
        tall *= 1 + RAGGED[wall.kind] * rng.standard_normal(count).clip(-2, 2)
    groups = FRONT_PANELS if wall.kind is WallKind.HOUSES else 1
    shape = (-(-count // groups), len(BANDS[wall.kind]))
    tints = 1 + VARIES[wall.kind] * rng.uniform(-1, 1, shape)
    return _Panels(wall.kind, ends_m, tall, tints.repeat(groups, axis=0)[:count])


Face = tuple[float, list[Pixels], list[tuple[Pixels, tuple[float, ...]]]]
"""Distance from the lens, outlines, and polygons with their colours."""


def _faces(panels: _Panels, view: View, pose: Pose, relief: Relief | None) -> list[Face]:
    """The panels before the camera and within WITHIN_M."""
    camera = view.camera
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    ends = (panels.ends_m - (x, y)) @ np.array([[cos, -sin], [sin, cos]])  # in vehicle axes
    turn = np.array([math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)])
    ahead = (ends - (camera.x_m, camera.y_m)) @ turn
    # The upper edge of a face lies nearer to the plane of a camera that looks down.
    above_m = max(float(panels.tall_m.max()) - camera.height_m, 0.0)
    nearest_m = (NEAR_M + above_m * max(math.sin(camera.pitch_down_rad), 0)) / math.cos(camera.pitch_down_rad)
    away = np.hypot(*(ends.mean(axis=1) - (camera.x_m, camera.y_m)).T)
    chosen = np.flatnonzero((ahead.max(axis=1) > nearest_m) & (away < WITHIN_M))
    found = []
    for i in chosen:
        a, b = ends[i]
        if panels.kind is WallKind.TREES:
            foot_m = np.array([*a, 0.0 if relief is None else relief.lift_at(*a)])
            found.append(_tree(panels, int(i), view, foot_m, float(away[i])))
            continue
        for this, (one, other) in enumerate(((0, 1), (1, 0))):
            if ahead[i, one] < nearest_m:
                share = (nearest_m - ahead[i, one]) / (ahead[i, other] - ahead[i, one])
                cut = ends[i, one] + share * (ends[i, other] - ends[i, one])
                a, b = (cut, b) if this == 0 else (a, cut)
        feet = [0.0 if relief is None else relief.lift_at(*point) for point in (a, b)]
        found.append(_face(panels, int(i), view, np.array([[*a, feet[0]], [*b, feet[1]]]), float(away[i])))
    return found


def _face(panels: _Panels, i: int, view: View, feet_m: Array, away_m: float) -> Face:
    """``feet_m``: x, y, z of both lower corners in vehicle axes."""
    tall_m, bands = panels.tall_m[i], BANDS[panels.kind]
    shares = [0.0, *(share for share, _ in bands)]
    levels = np.array(shares)[:, None, None] * (0, 0, tall_m) + feet_m  # (bands + 1, 2, 3)
    pixels = polygon(view.pixels(levels.reshape(-1, 3))[0]).reshape(-1, 2, 2)
    fills = []
    for band, (_, bgr) in enumerate(bands):
        corners = np.concatenate([pixels[band], pixels[band + 1][::-1]])
        fills.append((corners, _tint(bgr, panels.tints[i, band])))
    if panels.kind is WallKind.HOUSES:
        along = feet_m[1] - feet_m[0]
        length_m = float(np.linalg.norm(along)) or 1.0
        left, right = ((0.5 + side * WINDOW_M[0] / length_m / 2) for side in (-1, 1))
        for sill_m in (
            np.arange(SILL_M, tall_m - WINDOW_M[1] - 0.5, STOREY_M) if length_m > WINDOW_M[0] else ()
        ):
            lower = [feet_m[0] + share * along + (0, 0, sill_m) for share in (left, right)]
            corners_m = np.array(
                [*lower, *(np.add(corner, (0, 0, WINDOW_M[1])) for corner in reversed(lower))]
            )
            fills.append((polygon(view.pixels(corners_m)[0]), GLASS_BGR))
    return away_m, [np.concatenate([pixels[0], pixels[-1][::-1]])], fills


def _tree(panels: _Panels, i: int, view: View, foot_m: Array, away_m: float) -> Face:
    """``foot_m``: x, y, z of the middle of the trunk on the ground, in vehicle axes."""
    tall_m, (low, half) = panels.tall_m[i], CROWN
    sight = foot_m[:2] - (view.camera.x_m, view.camera.y_m)
    across = np.array([-sight[1], sight[0], 0.0]) / max(float(np.linalg.norm(sight)), NEAR_M)
    up = np.array([0.0, 0.0, tall_m])
    trunk_m = [foot_m + side * across * TRUNK_M / 2 + share * up for side, share in TRUNK_CORNERS]
    turns = np.linspace(0, 2 * math.pi, CROWN_CORNERS, endpoint=False)
    middle_m = foot_m + (1 + low) / 2 * up
    crown_m = [
        middle_m + half * tall_m * math.cos(t) * across + (1 - low) / 2 * math.sin(t) * up for t in turns
    ]
    outlines = [polygon(view.pixels(np.array(corners_m))[0]) for corners_m in (trunk_m, crown_m)]
    bands = zip(BANDS[panels.kind], panels.tints[i], strict=True)
    colours = [_tint(bgr, tint) for (_, bgr), tint in bands]
    return away_m, outlines, list(zip(outlines, colours, strict=True))


def _tint(bgr: tuple[int, int, int], tint: float) -> tuple[float, ...]:
    return tuple(min(float(tint) * c, 255.0) for c in bgr)
