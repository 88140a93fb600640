"""A street across: lines, steps and other surfaces at each lateral place, along the course of the road.

A street runs along one course: heading ψ, curvature κ, horizon. Along curves parallel to it lines and kerbs
continue, and everything else averages out. The profile holds for each lateral place the share of the visible image
rows with paint, the mean brightness step with its sign, and the share of the surface that is not that right ahead.

Lengths are those of a camera at the height of the belief; a camera of another height scales all of them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.grid import LateralGrid
from perception.lane.detection.points import MarkingFilter
from perception.lane.model.geometry import KAPPA, PSI, RoadPoints, parallel_curve
from perception.lane.street.settings import SearchSettings
from trepid.types import Array, Floats, Image, Mask

COLOUR_FLOOR = np.array([4.0, 1.5, 1.5])  # standard deviation of L, a and b on a plain surface
LIGHT_SHARE = 0.5  # of the deviation in L that counts, because light differs along a road
MAX_DEVIATION = 3.0  # standard deviations
MIN_ROWS = 10  # a place in fewer rows of the image is unknown
MAD_SIGMA = 1.48  # standard deviation of a normal distribution over its median absolute deviation
COARSE = 2  # the search uses every second row
MAX_SURPRISE = 9.0  # squared standard deviations of a course that is searched


@dataclass(frozen=True)
class StreetCourse:
    """Heading of the vehicle against the road, curvature of the road, row of the horizon [image widths]."""

    heading_rad: float
    curvature_1pm: float
    horizon: float


@dataclass(frozen=True)
class Profile:
    """What lies at each lateral place along a course; arrays of shape (places,), from left to right."""

    course: StreetCourse
    left_m: Array  # place at the rear axle
    seen: Mask  # in enough rows
    line: Array  # share of the rows with paint, above chance
    yellow: Array  # share of the painted rows whose paint is yellow
    step: Array  # mean brightness step to the right, in units of a clear one, −1..1
    other: Array  # share of the surface that is not that right ahead


@dataclass(frozen=True)
class LevelImage:
    """An image from a level camera: its points of paint, and maps (rows, places + 1), 0 outside the image."""

    points: RoadPoints
    rows: int  # visible ones, from the far end
    shown: Floats
    both: NDArray[np.complex64]  # paint + i·step
    yellow: Floats
    other: Floats
    chance: float  # share of the rows of a place with paint by chance


class StreetView:
    """Tables for images of one size, seen by a level camera whose horizon is its middle row."""

    def __init__(self, settings: SearchSettings, grid: LateralGrid, markings: MarkingFilter) -> None:
        self.settings, self.grid, self.markings = settings, grid, markings
        self.rows = np.flatnonzero(grid.ahead_m < settings.reach_m)
        self.left_m = np.arange(settings.half_range_m, -settings.half_range_m - 1e-9, -settings.step_m)
        self.row_px = (grid.top_px[self.rows] + grid.bottom_px[self.rows] - 1) / 2
        column = grid.camera.cx_px - grid.metre_px[self.rows, None] * self.left_m
        self.inside = (column > 0) & (column < grid.camera.width_px - 1)
        row = np.repeat(self.row_px.astype(np.float32)[:, None], len(self.left_m), axis=1)
        self.map = column.astype(np.float32), row
        self.heading_rad = np.linspace(-1, 1, settings.heading_steps) * settings.heading_range_rad
        self.curvature_1pm = np.linspace(-1, 1, settings.curvature_steps) ** 3 * settings.curvature_range_1pm
        self._coarse = {
            (heading, bend): self._table(heading, bend)
            for heading in range(settings.heading_steps)
            for bend in range(settings.curvature_steps)
        }

    def _table(self, heading: int, bend: int) -> tuple[NDArray[np.int32], NDArray[np.int16]]:
        """Of a course, in every ``COARSE``-th row: the index of its places, their visible rows down to each row."""
        index = self.index(float(self.heading_rad[heading]), float(self.curvature_1pm[bend]))[::COARSE]
        return index, _pad_column(self.inside).take(index).cumsum(axis=0).astype(np.int16)

    def index(self, heading_rad: float, curvature_1pm: float) -> NDArray[np.int32]:
        """Flat index of each place along a course in an array (rows, places + 1), whose last column is unknown."""
        camera, places = self.grid.camera, len(self.left_m)
        x_m = camera.x_m + self.grid.ahead_m[self.rows]
        y_m = parallel_curve(x_m[:, None], np.array(heading_rad), np.array(curvature_1pm), self.left_m)
        at = np.rint((self.left_m[0] - y_m) / self.settings.step_m)
        at = np.where((at >= 0) & (at < places), at, places).astype(np.int32)
        return at + (places + 1) * np.arange(len(self.rows), dtype=np.int32)[:, None]

    def profile(
        self, image: Image, horizon: float, near: StreetCourse | None = None
    ) -> tuple[Profile, LevelImage]:
        """The profile of ``image``, of the working width, along its best course, and the levelled image.

        ``horizon``: expected row, in widths of the image. Without ``near`` the course is searched straight ahead.
        """
        settings = self.settings
        around = near or StreetCourse(0.0, 0.0, horizon)
        sigma = settings.same_course if near else settings.any_course
        best, found = -np.inf, None
        steps = np.arange(settings.horizon_steps) - settings.horizon_steps // 2
        for step in steps.tolist():
            shift = horizon + step * settings.horizon_step
            surprise = ((shift - around.horizon) / sigma.horizon) ** 2
            if surprise > MAX_SURPRISE:
                continue
            maps = _level_maps(self, image, shift)
            score, at = self._sharpest(maps, around, surprise, near is not None)
            if score > best:
                best, found = score, (maps, at, shift)
        assert found is not None  # the middle horizon is searched always
        maps, (heading, bend), shift = found
        course = StreetCourse(float(self.heading_rad[heading]), float(self.curvature_1pm[bend]), shift)
        return self._along(course, maps), maps

    def step_points(self, levelled: LevelImage, lane: Array, left_m: float) -> RoadPoints:
        """The clearest step near the curve ``left_m`` of ``lane`` in each row, far to near."""
        settings, grid = self.settings, self.grid
        index = self.index(float(lane[PSI]), float(lane[KAPPA]))
        at = int(np.abs(self.left_m - left_m).argmin())
        reach = max(1, round(settings.gate_m / settings.step_m))
        first = max(0, at - reach)
        window = index[:, first : at + reach + 1]
        step = np.abs(levelled.both.take(window).imag)
        best = step.argmax(axis=1)
        row = np.flatnonzero(step.max(axis=1) > settings.clear_step)
        place = window[row, best[row]] - (len(self.left_m) + 1) * row
        x_m, y_m = grid.vehicle_from_grid(grid.ahead_m[self.rows[row]], self.left_m[place])
        return RoadPoints(
            x_m=x_m,
            y_m=y_m,
            sigma_m=np.hypot(settings.step_sigma_m, 0.7 / grid.metre_px[self.rows[row]]),
            weight=step.max(axis=1)[row].astype(np.float64),
            band=self.rows[row],
            half_m=np.zeros(len(row)),
        )

    def _sharpest(
        self, maps: LevelImage, around: StreetCourse, surprise: float, is_near: bool
    ) -> tuple[float, tuple[int, int]]:
        """Score and place in the table of the course along which paint and steps are concentrated the most.

        The score is the sum of the squares over all places; courses far from ``around`` count less.
        """
        settings = self.settings
        sigma = settings.same_course if is_near else settings.any_course
        best, found = -np.inf, (0, 0)
        coarse = -(-maps.rows // COARSE)
        for at, (index, shown) in self._coarse.items():
            off = surprise + ((self.heading_rad[at[0]] - around.heading_rad) / sigma.heading_rad) ** 2
            off += ((self.curvature_1pm[at[1]] - around.curvature_1pm) / sigma.curvature_1pm) ** 2
            if off > MAX_SURPRISE:
                continue
            sums, count = maps.both.take(index[:coarse]).sum(axis=0), shown[coarse - 1]
            rows = np.maximum(count, MIN_ROWS / COARSE)
            line = np.maximum(sums.real / rows - maps.chance, 0)
            step = np.maximum(np.abs(sums.imag) / rows - settings.step_chance, 0)
            score = float(count @ (line**2 + settings.step_weight * step**2)) / len(index)
            score -= settings.course_weight * float(off)
            if score > best:
                best, found = score, at
        return best, found

    def _along(self, course: StreetCourse, maps: LevelImage) -> Profile:
        index = self.index(course.heading_rad, course.curvature_1pm)
        count = maps.shown.take(index).sum(axis=0)
        rows = np.maximum(count, 1)
        both = maps.both.take(index).sum(axis=0)
        painted = np.maximum(both.real, 1)
        return Profile(
            course=course,
            left_m=self.left_m,
            seen=count >= MIN_ROWS,
            line=np.maximum(both.real / rows - maps.chance, 0) / max(1 - maps.chance, 0.05),
            yellow=maps.yellow.take(index).sum(axis=0) / painted,
            step=both.imag / rows,
            other=maps.other.take(index).sum(axis=0) / rows,
        )


def _level_maps(street: StreetView, image: Image, horizon: float) -> LevelImage:
    settings, level = street.settings, _level_image(street, image, horizon)
    points = street.markings.points(level)
    flat = cv2.remap(level, *street.map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    lab = cv2.cvtColor(flat.astype(np.uint8, copy=False), cv2.COLOR_BGR2Lab).astype(np.float32)
    last_px = image.shape[0] - 1 + street.grid.camera.cy_px - horizon * image.shape[1]
    inside = street.inside & (street.row_px <= last_px)[:, None]
    line = _paint_weight(street, points, inside)
    apart = max(1, round(settings.step_window_m / settings.step_m))
    light = cv2.blur(lab[..., 0], (apart, 1))
    change = np.zeros_like(light)
    change[:, apart:-apart] = light[:, 2 * apart :] - light[:, : -2 * apart]
    patch = inside & (np.abs(street.left_m) < settings.patch_half_width_m)
    patch[: len(patch) // 2] = False
    own = lab[patch] if patch.any() else lab.reshape(-1, 3)
    middle = np.median(own, axis=0)
    sigma = MAD_SIGMA * np.median(np.abs(own - middle), axis=0) + COLOUR_FLOOR
    texture = float(np.median(np.abs(change[inside]))) if inside.any() else 0.0
    step = np.clip(change / max(settings.min_step_grey, settings.step_sigma * texture), -1, 1)
    deviation = (lab - middle) * (np.array((LIGHT_SHARE, 1.0, 1.0)) / sigma)
    other = (deviation**2).sum(axis=2) > MAX_DEVIATION**2
    yellow = line * (lab[..., 2] > middle[2] + settings.yellow_b)
    return LevelImage(
        points=points,
        rows=max(1, int(np.count_nonzero(street.row_px <= last_px))),
        shown=_pad_column(inside),
        both=(_pad_column(line * inside) + 1j * _pad_column(step * inside)).astype(np.complex64),
        yellow=_pad_column(yellow * inside),
        other=_pad_column(other & inside),
        chance=float(line[inside].mean()) if inside.any() else 0.0,
    )


def _pad_column(values: NDArray[np.generic]) -> Floats:
    """``values`` with a column of 0 on the right."""
    return np.pad(values.astype(np.float32), ((0, 0), (0, 1)))


def _level_image(street: StreetView, image: Image, horizon: float) -> Image:
    """``image`` moved down so that the horizon is the middle row of the level camera."""
    camera = street.grid.camera
    down_px = camera.cy_px - horizon * image.shape[1]
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, down_px]])
    size = camera.width_px, camera.height_px
    return cv2.warpAffine(image, move, size, borderMode=cv2.BORDER_REPLICATE).astype(np.uint8, copy=False)


def _paint_weight(street: StreetView, points: RoadPoints, inside: Mask) -> Floats:
    """Weight of the paint in each row and place."""
    line, places = np.zeros(inside.shape, np.float32), len(street.left_m)
    near = points.band >= street.rows[0]
    place = np.rint((street.left_m[0] - points.y_m) / street.settings.step_m).astype(int)
    near &= (place >= 0) & (place < places)
    line[points.band[near] - street.rows[0], place[near]] = np.minimum(2 * points.weight[near], 1)
    return np.asarray(cv2.dilate(line, np.ones((1, 3), np.uint8)), np.float32)
