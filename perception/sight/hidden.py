"""Occlusion: where a thing that stands on the ground hides the road, from its sides (:mod:`.upright`).

*In the lane.* Between two sides on the left and on the right of the lane, as far apart as those of a vehicle,
nothing looks as the road right before it does: the sight ends at the base. Both sides of a thing end there, too.
Two things that stand on the left and on the right of the lane leave a gap with two sides, in which the road is seen
up to the horizon: there the sides end below what looks otherwise, and far ground that gets lighter is no step.

*Beside the lane.* A wall, a hedge or a house on the inside of a bend hides what lies behind its last visible
side. A wall that follows the lane at the distance c is touched by the line of sight at

    t = √(b² + 2·R·c)

where the bend of radius R begins b ahead, and the line meets the lane again √(2·R·c) beyond, so that the sight
is 2·t within the bend, and a little less before it. Near the point of contact the base of the wall deviates from
the column of its side by f·δ²/(2·R·t) pixels at the distance t - δ, so that the base is seen to leave the side,
by τ pixels,

    δ/t = √(τ·(t - δ)/(f·c)·q)        q: 1 within the bend, 0 before it, by the sag of the lane over c

too near. Before the bend this error is left: it is about as large as that of 2·t, and opposite.

The lane as it is expected bends by its sag p up to the base, and meets the line of sight at (1 + c/p) times the
distance of the base: the nearer of the two counts.

Two conditions separate such a thing from one beside a straight road. It hides the horizon: the image does not step
there, as it does where ground meets trees or sky. And either the lane bends towards it, or the lane as it is
expected looks as the ground beside the road, between the thing and the place where the line of sight meets it.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from perception.sight.settings import HiddenSettings
from perception.sight.strip import Path
from perception.sight.upright import GRAIN_PX, Edge, Look, UprightEdges
from trepid.car.camera import Camera
from trepid.types import Array, Image

ROAD_HALF_M = 1.2  # of the ground of the lane that gives the look of the road
BESIDE_M = (5.5, 14.0)  # ground beside the road
SAMPLE_M = (20.0, 6.0)  # distances of this ground from the lens
SAMPLE_ROWS = 10
LEAST_ROWS = 3  # of a thing in the image before the ground that it stands on, for its shadow
LEAVES_PX = 4.0  # τ: an edge is at most two columns wide to both sides
WITHIN = 0.5  # sag of the lane over c where a base that is seen too near by 0.7 lies within a bend
WHOLE, LOST = 0.7, 0.5  # shares of pixels that look otherwise
BASE_PX = 0.7  # error of a base
SIDE_PX = 2.0  # rows by which the shorter side of a thing reaches below its base, for the smoothing of edges
BASE_STEP = 2.0  # times the least step of a side: of a base above the ends of its sides
BEYOND_PX = (3, 13)  # columns beyond a side, in which a thing hides the horizon
AHEAD_HALF_M = 0.9  # of the lane that a thing in it fills
BASE_UNKNOWN_M = 3.0  # error of the lane at a thing whose base is not yet known
NEAREST, FARTHEST = 1.1, 2.2  # times the distance of a wall: ground between it and the end of the sight


class End(NamedTuple):
    """The end of the sight in one frame: distance from the lens, deviation of its logarithm."""

    distance_m: float
    sigma: float


class HiddenRoad:
    """Looks for what hides the lane in images of one camera."""

    def __init__(self, camera: Camera, settings: HiddenSettings) -> None:
        self._camera, self._settings = camera, settings
        self._edges = UprightEdges(camera, settings)
        self._road_from_pixel = np.linalg.inv(camera.pixel_from_road_matrix)
        below = [row > self._horizon_px for row in range(camera.height_px)]
        self._rows_m = np.array(
            [self._distance_m(row) if is_below else math.nan for row, is_below in enumerate(below)]
        )
        self._per_m = (camera.fx_px / self._rows_m).tolist()

    def end(self, image: Image, path: Path) -> End | None:
        """The nearest end of the sight along ``path``; None without one.

        ``image``: grey or BGR, without lens distortion.
        """
        if not self._edges.is_usable:
            return None
        if image.ndim == 2 or image.shape[2] == 1:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
        edges = self._edges.find(image)
        if not edges:
            return None
        columns_px = path.column_at(self._rows_m + self._camera.x_m).tolist()
        ends = [
            *self._in_the_lane(image, path, columns_px, edges),
            *self._beside_it(image, path, columns_px, edges),
        ]
        return min(ends, default=None)

    def _in_the_lane(
        self, image: Image, path: Path, columns_px: list[float], edges: list[Edge]
    ) -> Iterator[End]:
        """Ends at things between two sides; ``columns_px``: of the lane in every row, NaN above the horizon."""
        least_m, most_m = self._settings.vehicle_m
        for i, left in enumerate(edges):
            for right in edges[i + 1 :]:
                # The line of the lane may continue a side downwards, but nothing shortens one.
                row = min(left.base_row_px, right.base_row_px)
                distance_m = self._distance_m(row)
                width_m = (right.column_px - left.column_px) * distance_m / self._camera.fx_px
                if width_m > most_m:
                    break
                if width_m < least_m or not self._is_ahead(path, left, right, distance_m, BASE_UNKNOWN_M):
                    continue
                base_row = self._base_row(image, path, columns_px, left, right, math.ceil(row))
                if base_row is None:
                    continue
                if row - base_row > SIDE_PX:
                    columns = image[:, self._ahead(path, left, right, math.ceil(row))]
                    if _base_step_grey(columns, base_row) < BASE_STEP * self._settings.least_step_grey:
                        continue  # a gap between two things
                distance_m = self._distance_m(base_row)
                error_m = self._settings.lane_error_1pm * distance_m**2 / 2
                if self._is_ahead(path, left, right, distance_m, error_m):
                    sigma = BASE_PX / (base_row - self._horizon_px)
                    yield End(distance_m, math.hypot(sigma, self._settings.vehicle_sigma))

    def _is_ahead(self, path: Path, left: Edge, right: Edge, distance_m: float, error_m: float) -> bool:
        """Whether the lane runs between two sides at a distance from the lens, with an error of the lane."""
        error_px = error_m * self._camera.fx_px / distance_m
        column_px = self._column(path, distance_m)
        return left.column_px - error_px < column_px < right.column_px + error_px

    def _base_row(
        self, image: Image, path: Path, columns_px: list[float], left: Edge, right: Edge, last: int
    ) -> float | None:
        """The row up to which nothing between two sides looks as the road before it; None where something does.

        The sides end in row ``last`` or above it.
        """
        before_m = self._distance_m(last + LEAST_ROWS), self._distance_m(last + LEAST_ROWS + SAMPLE_ROWS)
        look = Look.of(self._ground(image, columns_px, (-ROAD_HALF_M, ROAD_HALF_M), before_m))
        if look is None:
            return None
        first = round(self._horizon_px) + GRAIN_PX
        rows = image[first : last + 1, self._ahead(path, left, right, last)]
        if rows.size == 0:
            return None
        is_other = (look.distance(rows) > self._settings.other_sigmas).mean(axis=1) >= WHOLE
        found = np.flatnonzero(is_other)
        if len(found) == 0 or is_other[: found[-1] + 1].mean() < WHOLE:
            return None
        base_row = first + int(found[-1]) - 0.5 + _covered_share(rows[: found[-1] + 1], look.mean)
        return base_row if self._distance_m(base_row) <= self._settings.far_m else None

    def _ahead(self, path: Path, left: Edge, right: Edge, row_px: float) -> slice:
        """The columns between two sides that the car would drive through, by the distance of a row."""
        half_px = AHEAD_HALF_M * self._camera.fx_px / self._distance_m(row_px)
        middle_px = (left.column_px + right.column_px) / 2
        room_px = max(middle_px - left.column_px - half_px, 0.0)
        column_px = self._column(path, self._distance_m(row_px))
        column_px = min(max(column_px, middle_px - room_px), middle_px + room_px)
        return slice(math.floor(column_px - half_px) + 1, math.ceil(column_px + half_px))

    def _beside_it(
        self, image: Image, path: Path, columns_px: list[float], edges: list[Edge]
    ) -> Iterator[End]:
        """Ends behind the nearest side on the left and on the right of the lane."""
        left_m = self._left_m(path, edges)
        for side in (1.0, -1.0):
            found = np.flatnonzero((side * left_m > 0.0) & (side * left_m <= self._settings.beside_m))
            if len(found) == 0:
                continue
            # Of the sides of one wall, as of its windows, the one nearest to the lane in the image is the last one.
            number = found[-1] if side > 0 else found[0]
            edge, aside_m = edges[number], side * float(left_m[number])
            if aside_m < ROAD_HALF_M or not self._hides_horizon(image, edge, side):
                continue
            near_m = self._distance_m(edge.base_row_px)
            bends = self._sag_m(path, near_m, side) / aside_m
            within = min(max(bends / WITHIN, 0.0), 1.0)
            too_near = math.sqrt(LEAVES_PX * near_m / (self._camera.fx_px * aside_m) * within)
            distance_m = 2.0 * near_m / (1.0 - min(too_near, 0.5))
            if bends > 0.0:
                distance_m = min(distance_m, near_m * (1.0 + 1.0 / bends))
            if distance_m > 2.0 * self._settings.far_m:
                continue
            if bends >= self._settings.bend_share or self._is_lost(image, columns_px, near_m, side):
                yield End(distance_m, self._settings.wall_sigma)

    def _hides_horizon(self, image: Image, edge: Edge, side: float) -> bool:
        """Whether the image steps at the horizon much less beyond ``edge`` than before it, where ground ends."""
        beyond, before = (self._horizon_step_grey(image, edge.column_px, sign * side) for sign in (-1.0, 1.0))
        return beyond < self._settings.horizon_share * before

    def _horizon_step_grey(self, image: Image, column_px: float, sign: float) -> float:
        """Largest difference over three rows around the horizon, of the mean colour of some columns beside one.

        ``sign``: +1 for the columns to its right. Infinite where the image does not show them.
        """
        first, last = sorted(round(column_px + sign * off_px) for off_px in BEYOND_PX)
        row = round(self._horizon_px)
        around = image[row - 4 : row + 6, max(first, 0) : max(last, 0)]
        if around.shape[1] < BEYOND_PX[0]:
            return math.inf
        colours = around.mean(axis=1)
        return float(np.abs(colours[3:] - colours[:-3]).max())

    def _left_m(self, path: Path, edges: list[Edge]) -> Array:
        """Distances of the bases of ``edges`` from the lane, left positive, (n,)."""
        pixels = np.array([(edge.column_px, edge.base_row_px, 1.0) for edge in edges])
        x, y, scale = self._road_from_pixel @ pixels.T
        return np.asarray(y / scale - path.left_m(x / scale))

    def _sag_m(self, path: Path, distance_m: float, side: float) -> float:
        """How far the lane bends to ``side`` up to a distance from the lens, beside its straight continuation."""
        x_m = distance_m + self._camera.x_m
        slope = (path.y_m[1] - path.y_m[0]) / (path.x_m[1] - path.x_m[0])
        return side * float(path.left_m(np.array(x_m)) - path.y_m[0] - slope * x_m)

    def _is_lost(self, image: Image, columns_px: list[float], near_m: float, side: float) -> bool:
        """Whether the lane looks as the ground beside it in a row between a wall and the end of the sight."""
        outside = (-BESIDE_M[1], -BESIDE_M[0]) if side > 0 else BESIDE_M
        road = Look.of(self._ground(image, columns_px, (-ROAD_HALF_M, ROAD_HALF_M)))
        beside = Look.of(self._ground(image, columns_px, outside))
        if road is None or beside is None or road.apart(beside) < self._settings.least_apart:
            return False
        first = max(self._row(FARTHEST * near_m), round(self._horizon_px) + GRAIN_PX)
        last = self._row(NEAREST * near_m) + 1
        last = min(last, len(image))
        strips = (
            self._strip(image, columns_px, row, (-ROAD_HALF_M, ROAD_HALF_M)) for row in range(first, last)
        )
        rows = [strip for strip in strips if len(strip)]
        if not rows:
            return False
        pixels = np.concatenate(rows)
        off = beside.distance(pixels)
        as_beside = (off < road.distance(pixels)) & (off < self._settings.beside_sigmas)
        starts = np.cumsum([0, *map(len, rows[:-1])])
        shares = np.add.reduceat(as_beside.astype(float), starts) / list(map(len, rows))
        return bool(shares.max() > LOST)

    def _ground(
        self,
        image: Image,
        columns_px: list[float],
        between_m: tuple[float, float],
        from_to_m: tuple[float, float] = SAMPLE_M,
    ) -> Array:
        """Colours (n, 3) of the ground at lateral distances from the lane, left positive, from far to near."""
        first, last = map(self._row, from_to_m)
        rows = range(first, min(last, len(image)), max((last - first) // SAMPLE_ROWS, 1))
        parts = [self._strip(image, columns_px, row, between_m) for row in rows]
        return np.concatenate([np.empty((0, 3)), *parts])

    def _strip(
        self, image: Image, columns_px: list[float], row: int, between_m: tuple[float, float]
    ) -> Image:
        """The pixels of a row between lateral distances from the lane, left positive."""
        column_px, per_m = columns_px[row], self._per_m[row]
        if not math.isfinite(column_px):
            return image[row, :0]
        width = image.shape[1]
        first = min(max(math.floor(column_px - between_m[1] * per_m), 0), width)
        return image[row, first : max(min(math.ceil(column_px - between_m[0] * per_m) + 1, width), first)]

    def _column(self, path: Path, distance_m: float) -> float:
        return float(path.column_at(np.array(distance_m + self._camera.x_m)))

    @property
    def _horizon_px(self) -> float:
        return self._camera.horizon_row_px

    def _row(self, distance_m: float) -> int:
        """Row of flat ground at a distance from the lens; outside of the image for ground out of sight."""
        camera = self._camera
        below_rad = math.atan2(camera.height_m, distance_m) - camera.pitch_down_rad
        return round(camera.cy_px + camera.fy_px * math.tan(below_rad))

    def _distance_m(self, row_px: float) -> float:
        """Distance from the lens of flat ground in a row below the horizon."""
        camera = self._camera
        below_rad = math.atan((row_px - camera.cy_px) / camera.fy_px) + camera.pitch_down_rad
        return camera.height_m / math.tan(below_rad)


def _base_step_grey(columns: Image, base_row_px: float) -> float:
    """Greatest difference of a channel between the rows above a base and below it; ``columns``: (n, columns, 3)."""
    base = math.ceil(base_row_px)
    above, below = (columns[base + first : base + first + 2].mean(axis=(0, 1)) for first in (-2, 2))
    return float(np.abs(above - below).max())


def _covered_share(rows: Image, road: Array) -> float:
    """Share of the last of ``rows`` (n, columns, 3) that the thing covers which fills the row above it."""
    last = rows[-1].mean(axis=0) - road
    thing = rows[max(len(rows) - 2, 0)].mean(axis=0) - road
    return min(max(float(last @ thing) / max(float(thing @ thing), 1.0), 0.0), 1.0)


class HiddenWatch:
    """What hides the lane in most of the last frames."""

    def __init__(self, settings: HiddenSettings) -> None:
        self._settings = settings
        self._ends: deque[tuple[float, End | None]] = deque()

    def step(self, end: End | None, t_s: float) -> End | None:
        """The end in the median of the frames of the last moments; None where most of them show none."""
        settings = self._settings
        if self._ends and not 0.0 <= t_s - self._ends[-1][0] <= settings.memory_s:
            self._ends.clear()
        self._ends.append((t_s, end))
        while self._ends[0][0] < t_s - settings.memory_s:
            self._ends.popleft()
        found = sorted(one for _, one in self._ends if one is not None)
        if t_s - self._ends[0][0] < settings.memory_s / 2 or len(found) < settings.seen_share * len(
            self._ends
        ):
            return None
        return found[len(found) // 2]
