"""Edges of an unmarked road: the lane shape that encloses the most road likelihood."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane.detection.grid import LateralGrid, lateral_grid, row_places
from perception.lane.detection.surface import SurfaceBins, SurfaceSettings, road_likelihood, surface_bins
from perception.lane.model.geometry import (
    KAPPA,
    PSI,
    WIDTH,
    E,
    LaneState,
    RoadPoints,
    lane_coordinates,
    parallel_curve,
)
from trepid.car.camera import Camera
from trepid.config import Settings
from trepid.types import Array, Floats, Image, NonNegative, Positive

COARSE = 2  # the search over all shapes uses every second place and band


class EdgeSettings(Settings):
    """Section ``edges`` of ``config/perception.yaml``."""

    working_width_px: Annotated[int, Field(ge=32)]
    reach_m: Positive
    band_m: Positive
    half_range_m: Positive
    step_m: Positive
    patch_start_m: Positive
    patch_length_m: Positive
    patch_half_width_m: Positive
    rest_half_width_m: Positive
    place_range_m: Positive
    place_step_m: Positive
    heading_range_rad: Positive
    heading_steps: Annotated[int, Field(ge=2)]
    curvature_range_1pm: Positive
    curvature_steps: Annotated[int, Field(ge=2)]
    prior_weight: Positive
    step_weight: NonNegative
    full_step_grey: Positive
    window_m: Positive
    margin_m: Positive
    compare_m: Positive
    beside_m: Positive
    full_contrast: Positive
    min_contrast: Positive
    sigma_m: Positive
    surface: SurfaceSettings


@dataclass(frozen=True)
class RoadImage:
    """The part of an image below the far end of the grid, and its colour bins."""

    below: Image
    bins: SurfaceBins


def edge_grid(settings: EdgeSettings, camera: Camera) -> LateralGrid:
    """The grid in which edges are searched in images from ``camera``, without rows where it shows no road."""
    width_px = min(camera.width_px, settings.working_width_px)
    height_px = max(1, round(camera.height_px * width_px / camera.width_px))
    # The settings hold for c' = s·c, which is (1 - s)/2 of a pixel beside the centre of the resized image.
    centre = dict(
        cx_px=camera.cx_px * (width_px / camera.width_px),
        cy_px=camera.cy_px * (height_px / camera.height_px),
    )
    resized = camera.resize(width_px, height_px).model_copy(update=centre)
    return lateral_grid(resized, reach_m=settings.reach_m, band_m=settings.band_m, max_band_px=4)


class RoadEdgeFinder:
    """Finds the pair of parallel road edges in an image of a fixed size and camera."""

    def __init__(self, settings: EdgeSettings, grid: LateralGrid) -> None:
        """``grid``: that of :func:`edge_grid`, of at least one row."""
        self._settings, self._camera, self.grid = settings, grid.camera, grid
        self._first_row = int(self.grid.top_px[0])
        self._left_m = np.arange(settings.half_range_m, -settings.half_range_m - 1e-9, -settings.step_m)
        columns = self._camera.cx_px - self.grid.metre_px[:, None] * self._left_m + 0.5
        self._map_x = columns.astype(np.float32)
        rows = np.arange(len(self.grid.ahead_m), dtype=np.float32)[:, None]
        self._map_y = np.broadcast_to(rows, columns.shape).astype(np.float32)
        self._place_m = np.arange(-settings.place_range_m, settings.place_range_m, settings.place_step_m)
        self._step_rows = self._map_y + (
            (self.grid.top_px + self.grid.bottom_px - 1) / 2 - self._first_row - np.arange(len(rows))
        )[:, None].astype(np.float32)
        self._patch, self._rest = (np.flatnonzero(mask) for mask in self._masks())

    def _masks(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Pixels of the road right ahead of the vehicle, and pixels to the sides or far ahead."""
        settings, camera = self._settings, self._camera
        distance_m, depth_m = row_places(
            camera, np.arange(self._first_row, camera.height_px, dtype=float)[:, None]
        )
        aside_m = (camera.cx_px - np.arange(camera.width_px, dtype=float)) / camera.fx_px * depth_m
        self._road_x_m, self._road_y_m = self.grid.vehicle_from_grid(distance_m, aside_m)
        ahead, left = self._road_x_m - camera.x_m, self._road_y_m - camera.y_m
        start = float(np.min(ahead)) + settings.patch_start_m
        patch = (ahead > start) & (ahead < start + settings.patch_length_m)
        patch &= np.abs(left) < settings.patch_half_width_m
        return patch, (np.abs(left) > settings.rest_half_width_m) | (ahead >= settings.reach_m)

    def _masks_of(self, lane: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Pixels inside and outside the edges of ``lane``, at least ``margin_m`` from them."""
        margin_m = self._settings.margin_m
        _, distance, _ = lane_coordinates(self._road_x_m, self._road_y_m, lane)
        aside = np.abs(distance) - lane[WIDTH] / 2
        inside = (aside < -margin_m) & (self._road_x_m < self._settings.reach_m)
        return inside, aside > margin_m

    def prepare(self, image: Image) -> RoadImage:
        """``image``, of any size with the aspect ratio of the camera, resized, cut and binned."""
        size = (self._camera.width_px, self._camera.height_px)
        if image.shape[1::-1] != size:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        below = np.ascontiguousarray(image[self._first_row :])
        return RoadImage(below=below, bins=surface_bins(below))

    def sums(self, image: RoadImage, lane: Array | None = None) -> Floats:
        """Road likelihood summed from the left end of the grid to each place [nats·m], shape (bands, places).

        The sample of road is the patch ahead of the vehicle or, with ``lane``, its inside.
        """
        road, rest = (self._patch, self._rest) if lane is None else self._masks_of(lane)
        ratio = road_likelihood(image.bins, road, rest, self._settings.surface)
        integral = cv2.integral(ratio, sdepth=cv2.CV_64F)
        top, bottom = self.grid.top_px - self._first_row, self.grid.bottom_px - self._first_row
        running = (integral[bottom] - integral[top]) / ((bottom - top) * self.grid.metre_px)[:, None]
        maps = self._map_x, self._map_y
        border = cv2.BORDER_REPLICATE
        at_places = cv2.remap(running.astype(np.float32), *maps, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(at_places, np.float32)

    def steps(self, image: RoadImage) -> Floats:
        """Sharpness of kerbs, lines and verges, 0..1: |∂/∂u| of the green channel, limited, (bands, places)."""
        change = cv2.convertScaleAbs(cv2.Sobel(image.below[:, :, 1], cv2.CV_16S, 1, 0))
        full = np.float32(self._settings.full_step_grey)
        limited = np.minimum(cv2.blur(change, (3, 1)), full) / full
        columns = self._map_x - np.float32(0.5)
        return np.asarray(cv2.remap(limited, columns, self._step_rows, cv2.INTER_LINEAR), np.float32)

    def search(self, sums: Floats, steps: Floats, prior: LaneState, *, near: Array | None = None) -> Array:
        """State (6,) whose edges enclose the most road likelihood under ``prior``.

        Searches all shapes on a coarse grid, or shapes around the state ``near`` in half steps.
        """
        if near is None:
            return self._best(self._all_shapes, sums, steps, prior)
        settings, half_steps = self._settings, np.arange(-2, 3) / 2
        heading = near[PSI] + half_steps * 2 * settings.heading_range_rad / (settings.heading_steps - 1)
        bend = near[KAPPA] + half_steps * 2 * settings.curvature_range_1pm / (settings.curvature_steps - 1)
        return self._best(self._shapes(heading, bend, self._place_m, 1), sums, steps, prior)

    def _best(self, shapes: "Shapes", sums: Floats, steps: Floats, prior: LaneState) -> Array:
        heading, bend, place_m, index = shapes
        sigma = np.sqrt(np.diag(prior.covariance))
        places = len(place_m)
        inside = np.take(sums, index, mode="clip").mean(axis=0).reshape(-1, places).T
        sharp = np.take(steps, index, mode="clip").mean(axis=0).reshape(-1, places).T
        sharp *= self._settings.step_weight
        unlikely = ((heading - prior.mean[PSI]) / max(sigma[PSI], 0.02))[:, None] ** 2
        unlikely = unlikely + ((bend - prior.mean[KAPPA]) / max(sigma[KAPPA], 0.006)) ** 2
        found = prior.mean.copy()
        at, found[E], found[WIDTH] = _best_edges(
            inside + sharp, inside - sharp, unlikely.ravel(), place_m, prior, self._settings.prior_weight
        )
        found[PSI], found[KAPPA] = heading[at // len(bend)], bend[at % len(bend)]
        return found

    @cached_property
    def _all_shapes(self) -> "Shapes":
        """The shapes of a search over the whole range."""
        settings = self._settings
        heading = np.linspace(-settings.heading_range_rad, settings.heading_range_rad, settings.heading_steps)
        bend = np.linspace(
            -settings.curvature_range_1pm, settings.curvature_range_1pm, settings.curvature_steps
        )
        return self._shapes(heading, bend, self._place_m[::COARSE], COARSE)

    def _shapes(self, heading: Array, bend: Array, place_m: Array, every: int) -> "Shapes":
        """The curves of every heading, bend and place, in every ``every``-th band."""
        bands, places = np.arange(0, len(self.grid.ahead_m), every), len(self._left_m)
        ahead_m = self.grid.ahead_m[bands].astype(np.float32)[:, None, None, None]
        y_m = parallel_curve(
            np.float32(self._camera.x_m) + ahead_m,
            heading.astype(np.float32)[:, None, None],
            bend.astype(np.float32)[:, None],
            place_m.astype(np.float32),
        )
        axis_m = np.float32(self._camera.y_m) + np.float32(np.tan(self._camera.yaw_rad)) * ahead_m
        column = (np.float32(self._left_m[0]) + axis_m - y_m) * np.float32(1 / self._settings.step_m)
        index = np.minimum(np.maximum(column + np.float32(0.5), 0), places - 1).astype(np.intp)
        index += (places * bands)[:, None, None, None]
        return Shapes(heading, bend, place_m, index.reshape(len(bands), -1))

    def points(self, sums: Floats, mean: Array) -> tuple[RoadPoints, Array]:
        """Edge points near the curves of ``mean``, one per band and side, and their sides (+1 left, −1 right).

        From left to right the likelihood sum has its minimum at the left edge and its maximum at the right
        edge. The contrast is the mean likelihood just inside minus just outside.
        """
        settings, bands = self._settings, len(self.grid.ahead_m)
        reach = int(settings.window_m / settings.step_m)
        span = int(settings.compare_m / settings.step_m)
        side = np.array([[1.0], [-1.0]])
        middle, visible = self._runs(mean, side * mean[WIDTH] / 2)
        window = np.arange(-reach, reach + 1)
        place = middle[:, :, None] + window
        place = np.minimum(np.maximum(place, span), len(self._left_m) - 1 - span)
        at = place + (len(self._left_m) * np.arange(bands))[:, None]
        rising = np.take(sums, at + span) - 2 * np.take(sums, at) + np.take(sums, at - span)
        rising *= side[:, :, None].astype(np.float32)
        best = rising.argmax(axis=2)
        contrast = rising.max(axis=2) / settings.compare_m
        good = visible & (best > 0) & (best < 2 * reach) & (contrast > settings.min_contrast)
        on_right, band = np.nonzero(good)
        left_m = self._left_m[place[on_right, band, best[good]]]
        x, y = self.grid.vehicle_from_grid(self.grid.ahead_m[band], left_m)
        return (
            RoadPoints(
                x_m=x,
                y_m=y,
                sigma_m=np.hypot(settings.sigma_m, 0.7 / self.grid.metre_px[band]),
                weight=np.minimum(contrast[good] / settings.full_contrast, 1.0).astype(np.float64),
                band=band,
                half_m=np.zeros(len(band)),
            ),
            side[on_right, 0],
        )

    def apart(self, sums: Floats, lane: Array) -> float:
        """Mean log-likelihood of road within ``lane`` minus that beside its edges [nats]; 0 without a visible side.

        Low on snow tracks, where both are a mixture of road and snow.
        """
        bands = np.arange(len(self.grid.ahead_m))
        half_m, wide_m = lane[WIDTH] / 2, self._settings.beside_m
        places = np.array([half_m + wide_m, half_m, -half_m, -half_m - wide_m])[:, None]
        place, seen = self._runs(lane, places)
        place = np.minimum(np.maximum(place, 0), len(self._left_m) - 1)
        left, road, right = np.diff(sums[bands, place], axis=0)
        both = seen[:-1] & seen[1:]
        beside = np.concatenate([left[both[0]], right[both[2]]]) / wide_m
        within = road[both[1]] / lane[WIDTH]
        return float(within.mean() - beside.mean()) if len(beside) and len(within) else 0.0

    def _runs(self, lane: Array, left_m: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Curves ``left_m``, shape (n, 1), to the left of the middle of ``lane``, on the grid.

        Returns the index of the place in each band, which may lie beyond the grid, and whether the place is
        inside the image, both (n, bands).
        """
        x_m = self._camera.x_m + self.grid.ahead_m
        y_m = parallel_curve(x_m, lane[PSI], lane[KAPPA], left_m - lane[E])
        aside = y_m - self._camera.y_m - math.tan(self._camera.yaw_rad) * self.grid.ahead_m
        place = ((self._left_m[0] - aside) / self._settings.step_m + 0.5).astype(np.intp)
        return place, np.abs(aside) * self.grid.metre_px < self._camera.width_px / 2


class Shapes(NamedTuple):
    """Curves of a search: headings, bends, places, and their indices into the sums."""

    heading_rad: Array
    bend_1pm: Array
    place_m: Array
    places: NDArray[np.intp]  # flat indices, shape (bands, ψ·κ·place)


def _best_edges(
    on_left: Floats, on_right: Floats, unlikely: Array, place: Array, prior: LaneState, prior_weight: float
) -> tuple[int, float, float]:
    """The shape, the offset e and the width W of the two edges with the best sum between them.

    ``on_left`` and ``on_right``: the score of an edge at each place, shape (places, shapes).
    """
    step = place[1] - place[0]
    sigma_e, sigma_w = np.sqrt(np.diag(prior.covariance))[[E, WIDTH]]
    low = max(1, int(2.2 / step), int((prior.mean[WIDTH] - 2.5 * sigma_w) / step))
    high = min(len(place) - 1, max(low, int((prior.mean[WIDTH] + 2.5 * sigma_w) / step)))
    left = on_left - (prior_weight * unlikely).astype(np.float32)
    best, found = -np.inf, (0, 0.0, 0.0)
    for bins in range(low, high + 1):
        centre = place[:-bins] + bins * step / 2
        surprise = ((centre + prior.mean[E]) / max(sigma_e, 0.2)) ** 2
        surprise += ((bins * step - prior.mean[WIDTH]) / max(sigma_w, 0.2)) ** 2
        score = left[:-bins] - on_right[bins:]
        score -= (prior_weight * surprise).astype(np.float32)[:, None]
        at = int(score.argmax())
        if score.flat[at] > best:
            at_place, shape = divmod(at, score.shape[1])
            best, found = float(score.flat[at]), (shape, float(-centre[at_place]), float(bins * step))
    return found
