"""Edges of an unmarked road: the lane shape that holds the most road and the least of the rest."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lane_fit import KAPPA, PSI, WIDTH, Array, E, LaneState, lane_coordinates
from perception.lane_points import RoadPoints
from perception.lateral_grid import lateral_grid
from perception.road_surface import SurfaceSettings, road_likelihood
from trepid.camera import Camera
from trepid.config import Settings

Positive = Annotated[float, Field(gt=0)]
Bgr = NDArray[np.uint8]


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
    heading_steps: Annotated[int, Field(ge=1)]
    curvature_range_1pm: Positive
    curvature_steps: Annotated[int, Field(ge=1)]
    prior_weight: Positive
    step_weight: Annotated[float, Field(ge=0)]
    full_step_grey: Positive
    window_m: Positive
    margin_m: Positive
    compare_m: Positive
    full_contrast: Positive
    min_contrast: Positive
    sigma_m: Positive
    surface: SurfaceSettings


@dataclass(frozen=True)
class RoadSums:
    """Road likelihood summed from the left end of the grid to each place, in [nats·m]; shape (bands, places)."""

    summed: Array
    step: Array  # 0..1, how sharply the image changes across the place


class RoadEdgeFinder:
    """Finds the pair of parallel road edges in an image of a fixed size and camera."""

    def __init__(self, settings: EdgeSettings, camera: Camera) -> None:
        self._settings = settings
        width_px = min(camera.width_px, settings.working_width_px)
        self._camera = camera.resized(width_px, max(1, round(camera.height_px * width_px / camera.width_px)))
        self.grid = lateral_grid(
            self._camera, reach_m=settings.reach_m, band_m=settings.band_m, max_band_px=4
        )
        self._first_row = int(self.grid.top_px[0])
        self._left_m = np.arange(settings.half_range_m, -settings.half_range_m - 1e-9, -settings.step_m)
        columns = self._camera.cx_px - self.grid.metre_px[:, None] * self._left_m + 0.5
        self._map_x = columns.astype(np.float32)
        rows = np.arange(len(self.grid.ahead_m), dtype=np.float32)[:, None]
        self._map_y = np.broadcast_to(rows, columns.shape).astype(np.float32)
        half_m = settings.place_range_m
        self._place_m = np.arange(-half_m, half_m, settings.place_step_m)
        self._patch, self._rest = self._masks()

    def _masks(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Pixels that are road if the vehicle is on one, and pixels far enough aside to be something else."""
        settings, camera = self._settings, self._camera
        rows = np.arange(self._first_row, camera.height_px, dtype=float)
        columns = np.arange(camera.width_px, dtype=float)
        u, v = np.meshgrid(columns, rows)
        road = camera.road_from_pixel(np.column_stack([u.ravel(), v.ravel()]))
        ahead = (road[:, 0] - camera.x_m).reshape(u.shape)
        left = (road[:, 1] - camera.y_m).reshape(u.shape)
        self._road_x_m, self._road_y_m = road[:, 0].reshape(u.shape), road[:, 1].reshape(u.shape)
        start = float(np.nanmin(ahead)) + settings.patch_start_m
        patch = (ahead > start) & (ahead < start + settings.patch_length_m)
        patch &= np.abs(left) < settings.patch_half_width_m
        return patch, (np.abs(left) > settings.rest_half_width_m) | ~(ahead < settings.reach_m)

    def _masks_of(self, lane: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Pixels well inside and well outside the edges of ``lane``."""
        margin_m = self._settings.margin_m
        _, distance, _ = lane_coordinates(self._road_x_m, self._road_y_m, lane)
        aside = np.abs(distance) - lane[WIDTH] / 2
        inside = (aside < -margin_m) & (self._road_x_m < self._settings.reach_m)
        return inside, (aside > margin_m) | np.isnan(aside)

    def sums(self, image: Bgr, lane: Array | None = None) -> RoadSums:
        """Where the road is in ``image`` (any size of the right shape).

        Road is what looks like the patch ahead of the vehicle, or, with a state ``lane``, like what lies inside it.
        """
        size = (self._camera.width_px, self._camera.height_px)
        if image.shape[1::-1] != size:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        below = np.ascontiguousarray(image[self._first_row :])
        road, rest = (self._patch, self._rest) if lane is None else self._masks_of(lane)
        ratio = road_likelihood(below, road, rest, self._settings.surface)
        integral = cv2.integral(ratio, sdepth=cv2.CV_64F)
        top, bottom = self.grid.top_px - self._first_row, self.grid.bottom_px - self._first_row
        running = (integral[bottom] - integral[top]) / (bottom - top)[:, None]
        summed = cv2.remap(
            running.astype(np.float32),
            self._map_x,
            self._map_y,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return RoadSums(summed=summed / self.grid.metre_px[:, None], step=self._steps(below, top, bottom))

    def _steps(self, below: Bgr, top: NDArray[np.int64], bottom: NDArray[np.int64]) -> Array:
        """Sharpness of kerbs, lines and verges: |∂/∂u| of the green channel, limited, at the places of the grid."""
        change = cv2.convertScaleAbs(cv2.Sobel(below[:, :, 1], cv2.CV_16S, 1, 0))
        limited = np.minimum(cv2.blur(change, (3, 1)), self._settings.full_step_grey)
        rows = self._map_y + ((top + bottom - 1) / 2 - np.arange(len(top)))[:, None].astype(np.float32)
        sampled = cv2.remap(
            limited.astype(np.float32), self._map_x - 0.5, rows.astype(np.float32), cv2.INTER_LINEAR
        )
        return np.asarray(sampled, np.float64) / self._settings.full_step_grey

    def search(self, sums: RoadSums, prior: LaneState, *, wide: bool) -> Array:
        """State (6,) whose edges enclose the most road likelihood, around ``prior``."""
        settings = self._settings
        sigma = np.sqrt(np.diag(prior.covariance))
        if wide:
            heading, bend, index = self._all_shapes
        else:
            heading = prior.mean[PSI] + max(sigma[PSI], 0.02) * np.array([-1.5, 0, 1.5])
            bend = prior.mean[KAPPA] + max(sigma[KAPPA], 0.006) * np.array([-1.5, 0, 1.5])
            index = self._index(heading, bend)
        place = self._place_m
        inside = np.take(sums.summed, index).mean(axis=-1)
        sharp = settings.step_weight * np.take(sums.step, index).mean(axis=-1)
        best, e, width = _best_edges(inside, sharp, place, prior, sigma, settings.prior_weight)
        best -= settings.prior_weight * (
            ((heading - prior.mean[PSI]) / max(sigma[PSI], 0.02))[:, None] ** 2
            + ((bend - prior.mean[KAPPA]) / max(sigma[KAPPA], 0.006))[None, :] ** 2
        )
        at = np.unravel_index(int(np.argmax(best)), best.shape)
        found = prior.mean.copy()
        found[[E, PSI, KAPPA, WIDTH]] = e[at], heading[at[0]], bend[at[1]], width[at]
        return found

    @cached_property
    def _all_shapes(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """Headings, curvatures and their index for a search without memory: the same in every frame."""
        settings = self._settings
        heading = np.linspace(-settings.heading_range_rad, settings.heading_range_rad, settings.heading_steps)
        bend = np.linspace(
            -settings.curvature_range_1pm, settings.curvature_range_1pm, settings.curvature_steps
        )
        return heading, bend, self._index(heading, bend)

    def _index(self, heading: Array, bend: Array) -> NDArray[np.int64]:
        """Flat index into the sums of the curves (ψ, κ, place) in every band, shape (ψ, κ, places, bands)."""
        place = self._place_m
        x_m = (self._camera.x_m + self.grid.ahead_m)[None, None, None, :]
        y_m = parallel_curve(x_m, heading[:, None, None, None], bend[None, :, None, None], place[:, None])
        y_m = y_m - self._camera.y_m - np.tan(self._camera.yaw_rad) * self.grid.ahead_m
        column = ((self._left_m[0] - y_m) / self._settings.step_m + 0.5).astype(np.int64)
        np.clip(column, 0, len(self._left_m) - 1, out=column)
        return column + len(self._left_m) * np.arange(len(self.grid.ahead_m))

    def points(self, sums: RoadSums, mean: Array) -> tuple[RoadPoints, Array]:
        """Edge points near the curves of ``mean``, one per band and side, and their sides (+1 left, −1 right).

        On the left edge road begins (going right), so the sum up to the edge is smallest there; on the right edge
        it is largest. The contrast is the mean likelihood just inside minus just outside.
        """
        settings = self._settings
        bands = len(self.grid.ahead_m)
        reach = int(settings.window_m / settings.step_m)
        span = int(settings.compare_m / settings.step_m)
        x_m = self._camera.x_m + self.grid.ahead_m
        parts = []
        for side in (1.0, -1.0):
            y_m = parallel_curve(x_m, mean[PSI], mean[KAPPA], side * mean[WIDTH] / 2 - mean[E])
            aside = y_m - self._camera.y_m - np.tan(self._camera.yaw_rad) * self.grid.ahead_m
            middle = ((self._left_m[0] - aside) / settings.step_m + 0.5).astype(int)
            visible = np.abs(aside) * self.grid.metre_px < self._camera.width_px / 2
            index = np.clip(
                middle[:, None] + np.arange(-reach, reach + 1), span, len(self._left_m) - 1 - span
            )
            rows = np.arange(bands)[:, None]
            rising = side * (
                sums.summed[rows, index + span]
                - 2 * sums.summed[rows, index]
                + sums.summed[rows, index - span]
            )
            best = np.argmax(rising, axis=1)
            contrast = rising[rows[:, 0], best] / settings.compare_m
            good = visible & (best > 0) & (best < 2 * reach) & (contrast > settings.min_contrast)
            parts.append((rows[good, 0], index[rows[:, 0], best][good], contrast[good], side))
        band = np.concatenate([part[0] for part in parts])
        left_m = np.concatenate([self._left_m[part[1]] for part in parts])
        contrast = np.concatenate([part[2] for part in parts])
        side_of = np.concatenate([np.full(len(part[0]), part[3]) for part in parts])
        x, y = self.grid.vehicle_from_grid(self.grid.ahead_m[band], left_m)
        return (
            RoadPoints(
                x_m=x,
                y_m=y,
                sigma_m=np.hypot(settings.sigma_m, 0.7 / self.grid.metre_px[band]),
                weight=np.minimum(contrast / settings.full_contrast, 1.0),
                band=band,
            ),
            side_of,
        )


def parallel_curve(x_m: Array, heading_rad: Array, curvature_1pm: Array, place_m: Array) -> Array:
    """Lateral place y at ``x_m`` of the circle parallel to (ψ, κ) through the axle, ``place_m`` to its left.

    With θ = −ψ, κ_d = κ/(1 − κ·d) and (x0, y0) = d·(−sin θ, cos θ): sin φ = sin θ + κ_d·(x − x0) and
    y = y0 + (x − x0)·(sin φ + sin θ)/(cos φ + cos θ), which has no division by the curvature.
    """
    sin, cos = np.sin(-heading_rad), np.cos(heading_rad)
    bend = curvature_1pm / np.maximum(1 - curvature_1pm * place_m, 0.2)
    run = x_m + place_m * sin
    sin_end = np.clip(sin + bend * run, -0.98, 0.98)
    return place_m * cos + run * (sin_end + sin) / (np.sqrt(1 - sin_end**2) + cos)


def _best_edges(
    inside: Array, sharp: Array, place: Array, prior: LaneState, sigma: Array, prior_weight: float
) -> tuple[Array, Array, Array]:
    """For each (ψ, κ) the best sum between two edges, and its offset e and width W."""
    step = place[1] - place[0]
    low = max(1, int((prior.mean[WIDTH] - 2.5 * sigma[WIDTH]) / step))
    high = max(low, int((prior.mean[WIDTH] + 2.5 * sigma[WIDTH]) / step))
    best = np.full(inside.shape[:2], -np.inf)
    e, width = np.zeros_like(best), np.zeros_like(best)
    for bins in range(max(low, int(2.2 / step)), min(high, len(place) - 1) + 1):
        centre = place[:-bins] + bins * step / 2
        unlikely = ((centre + prior.mean[E]) / max(sigma[E], 0.2)) ** 2
        unlikely += ((bins * step - prior.mean[WIDTH]) / max(sigma[WIDTH], 0.2)) ** 2
        score = (inside + sharp)[:, :, :-bins] - (inside - sharp)[:, :, bins:] - prior_weight * unlikely
        at = np.argmax(score, axis=2)
        value = np.take_along_axis(score, at[:, :, None], axis=2)[:, :, 0]
        better = value > best
        best[better], e[better], width[better] = value[better], -centre[at][better], bins * step
    return best, e, width
