"""Middles of lines on the floor, in any direction and colour, brighter or darker than the floor beside them.

The image is resampled to a raster of the floor seen from above, because a line across the image has as many pixels
there as one along it. A line of the width w is a ridge or a valley of the smoothed raster g: the eigenvalue λ of
its Hessian that is larger in magnitude belongs to the direction across the line. Candidates are the local maxima of
|λ| across the line. Of a candidate at p with the unit vector n across it,

    contrast = min(±(g(p) - g(p + d·n)), ±(g(p) - g(p - d·n)))    d = 1.1·w

counts, the contrast to the more similar side, because it is zero at the edge of a patch of light and at a joint
between two surfaces. Three planes of colour are searched: grey, yellow against blue, red against green.

Lines of several widths are searched one by one. A line is a ridge at the scale of another width, too, of less
contrast or beside its middle: where two widths find one within the width of a narrow line, more contrast counts.

Steger, An unbiased detector of curvilinear structures, IEEE PAMI 20(2), 1998; the contrast is B02 of the review.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.tape.settings import FloorSettings, RoleSettings, YellowSide
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image, Mask

MARGIN_PX = 2.0  # of the image, inside which the raster reads
ASIDE = 1.1  # of the width of the line: where the floor beside it is compared
MAD = 0.6745  # median of |x| of a normal deviate
FAINT = 0.5  # contrast, by that of the strong lines, at which a line has about half their weight
REMEMBERED = 0.5  # weight of a line that has left the image, whose place has the errors of odometry
YELLOW_SHARE, YELLOW_GREY = 0.4, 20.0  # of the contrast in yellow by that in grey, and its least value

Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]


class TapePoints(NamedTuple):
    """Points in the vehicle frame on the middles of lines; arrays of shape (n,), and ``contrast`` (n, 3)."""

    x_m: Array
    y_m: Array
    course_rad: Array  # direction of the line, modulo π
    contrast: Array  # of grey, yellow - blue and red - green, with their signs [grey levels]
    line_m: Array  # width of the lines among which the point was found
    way_m: Array  # driven since the point was seen

    @property
    def size(self) -> Array:
        """The greatest contrast of each [grey levels]."""
        return _greatest(self.contrast)

    def where(self, kept: Mask) -> "TapePoints":
        """The points selected by the mask ``kept``."""
        return TapePoints._make(column[kept] for column in self)

    def plus(self, other: "TapePoints") -> "TapePoints":
        """These points and then those of ``other``."""
        return TapePoints._make(np.concatenate(pair) for pair in zip(self, other, strict=True))


def _greatest(contrast: Array) -> Array:
    return np.asarray(np.abs(contrast).max(axis=1, initial=0.0), float)


NO_POINTS = TapePoints(np.empty(0), np.empty(0), np.empty(0), np.empty((0, 3)), np.empty(0), np.empty(0))


class VotingPoints(NamedTuple):
    """Points of lines, and their weights (n,) where they lie left and right of the middle of a lane.

    The colour of a line may say on which side it bounds the lane: what a user knows of a track and no image shows.
    """

    points: TapePoints
    left: Array
    right: Array

    @classmethod
    def of(cls, points: TapePoints, settings: RoleSettings) -> Self:
        """``points`` with the weights of the lines that ``settings`` describe."""
        weight = np.where(points.way_m > 0, REMEMBERED, 1.0) * _alike(points)
        if settings.yellow is YellowSide.ANY:
            return cls(points, weight, weight)
        grey, yellow = points.contrast[:, 0], points.contrast[:, 1]
        own = (yellow > YELLOW_GREY) & (yellow > YELLOW_SHARE * np.abs(grey))
        sides = weight * own, weight * ~own
        return cls(points, *(sides if settings.yellow is YellowSide.LEFT else sides[::-1]))

    def weight(self, left_m: Array) -> Array:
        """Weight of every point at ``left_m`` left of the middle of a lane; lanes may be a further first axis."""
        return np.where(left_m > 0, self.left, self.right)


def _alike(points: TapePoints) -> Array:
    """Share of each point by its contrast c and the c₉ that nine tenths do not exceed: 1.25·c²/(c² + c₉²/4).

    The lines of a track are about equally strong; seams, shadows and the dark strip between a line and a bright
    floor beside it are weaker.
    """
    if not len(points.x_m):
        return np.empty(0)
    square = points.size**2
    return (1 + FAINT**2) * square / (square + FAINT**2 * np.quantile(square, 0.9))


@dataclass(frozen=True)
class FloorRaster:
    """The floor before the car from above: rows go forward, columns to the left, ``cell_m`` apart."""

    camera: Camera  # of the input image, with its distortion
    settings: FloorSettings
    lines_m: tuple[float, ...]  # widths of the lines, from narrow to wide

    @cached_property
    def x_m(self) -> Array:
        """Distance ahead of the rear axle of every row."""
        first_m = max(self.camera.x_m, 0.0)
        return np.arange(first_m, self.settings.reach_m, self.settings.cell_m)

    @cached_property
    def y_m(self) -> Array:
        """Distance to the left of every column."""
        half_m = self.settings.half_width_m
        return np.arange(-half_m, half_m + 1e-9, self.settings.cell_m)

    @cached_property
    def _pixels(self) -> Array:
        """Pixel (u, v) of the distorted image of every cell, shape (rows, columns, 2); far outside behind it."""
        x_m, y_m = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        camera = self.camera
        at = np.stack([x_m - camera.x_m, y_m - camera.y_m, np.full_like(x_m, -camera.height_m)], axis=-1)
        rays = at.reshape(-1, 3) @ camera.optical_from_vehicle.T
        ahead = rays[:, 2] > np.abs(rays[:, :2]).max(axis=1) / self.settings.widest
        pixels = np.full((len(rays), 2), -1e4)
        if ahead.any():
            zero = np.zeros(3)
            found, _ = cv2.projectPoints(rays[ahead], zero, zero, camera.intrinsics, camera.lens)
            pixels[ahead] = found.reshape(-1, 2)
        return pixels.reshape(*x_m.shape, 2)

    @cached_property
    def inside_image(self) -> Mask:
        """Cells inside the image, shape (rows, columns)."""
        u, v = np.moveaxis(self._pixels, 2, 0)
        inside = (u > MARGIN_PX) & (u < self.camera.width_px - 1 - MARGIN_PX)
        return np.asarray(inside & (v > MARGIN_PX) & (v < self.camera.height_px - 1 - MARGIN_PX))

    @cached_property
    def _searched_cells(self) -> tuple[Mask, ...]:
        """For each width of a line the cells whose neighbours across it are inside the image, too."""
        found = []
        for line_m in self.lines_m:
            size = 2 * round((ASIDE * line_m + self._sigma_m(line_m)) / self.settings.cell_m) + 1
            kernel = np.ones((size, size), np.uint8)
            eroded = cv2.erode(
                self.inside_image.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0
            )
            found.append(np.asarray(eroded > 0))
        return tuple(found)

    @cached_property
    def _maps(self) -> tuple[Floats, Floats]:
        pixels = self._pixels.astype(np.float32)
        return np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1])

    def _sigma_m(self, line_m: float) -> float:
        """Standard deviation of the smoothing, at which a line of ``line_m`` is a ridge of the greatest λ·σ²."""
        return float(max(line_m / np.sqrt(12), self.settings.cell_m))

    def sees(self, x_m: Array, y_m: Array, line_m: Array) -> Mask:
        """Whether the image shows lines of the widths ``line_m`` and the floor beside them at points, all (n,)."""
        cell_m = self.settings.cell_m
        row = np.rint((x_m - self.x_m[0]) / cell_m).astype(int)
        column = np.rint((y_m - self.y_m[0]) / cell_m).astype(int)
        inside = (row >= 0) & (row < len(self.x_m)) & (column >= 0) & (column < len(self.y_m))
        found = np.zeros(len(x_m), bool)
        for width_m, searched in zip(self.lines_m, self._searched_cells, strict=True):
            part = inside & (line_m == width_m)
            found[part] = searched[row[part], column[part]]
        return found

    def points(self, image: Image) -> TapePoints:
        """The middles of all lines in a BGR ``image``, at most ``most_points`` of them, spread evenly."""
        raster = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        found = [
            self._middles(np.asarray(raster, np.uint8), line_m, searched)
            for line_m, searched in zip(self.lines_m, self._searched_cells, strict=True)
        ]
        spread: list[Floats] = []
        if len(found) > 1:
            spread = [self._spread(rows, columns, contrast) for rows, columns, _, contrast in found]
        points = NO_POINTS
        for number, (rows, columns, across, contrast) in enumerate(found):
            course_rad = np.asarray(np.angle(1j * across), float)
            some = TapePoints(
                self.x_m[rows],
                self.y_m[columns],
                course_rad,
                contrast,
                np.full(len(rows), self.lines_m[number]),
                np.zeros(len(rows)),
            )
            stronger = np.zeros(len(rows), bool)
            for other in spread[:number] + spread[number + 1 :]:
                stronger |= other[rows, columns] > some.size
            points = points.plus(some.where(~stronger))
        every = max(1, -(-len(points.x_m) // self.settings.most_points))
        return points.where(np.arange(len(points.x_m)) % every == 0)

    def _middles(
        self, raster: Image, line_m: float, searched: Mask
    ) -> tuple[Indices, Indices, Complex, Array]:
        """Rows, columns, unit vectors across and contrasts of the middles of lines of one width."""
        planes = _smooth_planes(raster, self._sigma_m(line_m) / self.settings.cell_m)
        ridges = _ridges(planes, searched)
        rows, columns = np.nonzero((ridges.strength > self.settings.least_sigmas) & searched)
        across = ridges.across(rows, columns)
        crests = _are_crests(ridges.strength, rows, columns, across)
        rows, columns, across = rows[crests], columns[crests], across[crests]
        contrast = self._contrast(planes, line_m, rows, columns, across)
        found = _greatest(contrast) > self.settings.least_grey
        return rows[found], columns[found], across[found], contrast[found]

    def _spread(self, rows: Indices, columns: Indices, contrast: Array) -> Floats:
        """The greatest contrast within the width of a narrow line of every cell."""
        found = np.zeros(self.inside_image.shape, np.float32)
        found[rows, columns] = _greatest(contrast)
        size = 2 * round(self.lines_m[0] / self.settings.cell_m) + 1
        return np.asarray(cv2.dilate(found, np.ones((size, size), np.uint8)), np.float32)

    def _contrast(
        self, planes: Floats, line_m: float, rows: Indices, columns: Indices, across: Complex
    ) -> Array:
        """Contrast of each plane at the cells (n,) to the more similar side; 0 where the sides lie around it."""
        aside = ASIDE * line_m / self.settings.cell_m * across
        here = planes[:, rows, columns]
        left, right = (
            _read(planes, rows + sign * aside.real, columns + sign * aside.imag) for sign in (1.0, -1.0)
        )
        a, b = here - left, here - right
        least = np.where(np.abs(a) < np.abs(b), a, b)
        return np.asarray(np.where(a * b > 0, least, 0.0).T, float)


def _smooth_planes(raster: Image, sigma_px: float) -> Floats:
    """Grey, yellow - blue and red - green, smoothed, shape (3, rows, columns)."""
    smooth = cv2.GaussianBlur(raster.astype(np.float32), (0, 0), sigma_px)
    blue, green, red = np.moveaxis(smooth, 2, 0)
    yellow = (red + green) / 2
    return np.stack([0.114 * blue + 0.587 * green + 0.299 * red, yellow - blue, red - green])


class Ridges(NamedTuple):
    """The Hessian of the plane in which a cell is most like a line; arrays of shape (rows, columns)."""

    strength: Floats  # |λ| over its noise, of the eigenvalue λ that is larger in magnitude
    half: Floats  # half of the trace
    apart: Floats  # half of the difference of the second derivatives along rows and columns
    mixed: Floats  # the mixed derivative

    def across(self, rows: Indices, columns: Indices) -> Complex:
        """Unit vectors across the line at the cells (n,), as row + i·column: the eigenvectors of λ."""
        at = rows, columns
        angle = 0.5 * np.arctan2(self.mixed[at], self.apart[at]) + np.where(self.half[at] < 0, np.pi / 2, 0.0)
        return np.asarray(np.exp(1j * angle), np.complex128)


def _ridges(planes: Floats, searched: Mask) -> Ridges:
    """The plane with the greatest strength at every cell."""
    found = [_hessian(plane, searched) for plane in planes]
    best = np.argmax([one.strength for one in found], axis=0)
    return Ridges._make(np.choose(best, fields) for fields in zip(*found, strict=True))


def _hessian(plane: Floats, searched: Mask) -> Ridges:
    rows = cv2.Sobel(plane, cv2.CV_32F, 0, 2, ksize=3)
    columns = cv2.Sobel(plane, cv2.CV_32F, 2, 0, ksize=3)
    mixed = cv2.Sobel(plane, cv2.CV_32F, 1, 1, ksize=3)
    half, apart = np.asarray((rows + columns) / 2, np.float32), np.asarray((rows - columns) / 2, np.float32)
    strength = np.abs(half) + cv2.magnitude(apart, mixed)
    noise = float(np.median(strength[searched])) / MAD if searched.any() else 0.0
    return Ridges(
        np.asarray(strength / max(noise, 1e-3), np.float32), half, apart, np.asarray(mixed, np.float32)
    )


def _are_crests(strength: Floats, rows: Indices, columns: Indices, across: Complex) -> Mask:
    """Which of the cells (n,) are at least as strong as both neighbours across the line."""
    here = strength[rows, columns]
    beside = [
        _read(strength[None], rows + sign * across.real, columns + sign * across.imag)[0] for sign in (1, -1)
    ]
    return np.asarray((here >= beside[0]) & (here > beside[1]))


def _read(planes: Floats, rows: Array, columns: Array) -> Floats:
    """Values of the planes at fractional cells (n,), shape (planes, n)."""
    if not len(rows):
        return np.empty((len(planes), 0), np.float32)
    at = columns.astype(np.float32)[None], rows.astype(np.float32)[None]
    return np.concatenate(
        [cv2.remap(plane, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for plane in planes]
    )
