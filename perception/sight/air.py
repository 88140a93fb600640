"""Fog, rain, snow and spray in the air: the meteorological optical range from the light of the ground.

Koschmieder (1924): a surface of light R at the distance d has the light

    L(d) = R·exp(-β·d) + A·(1 - exp(-β·d))

with the extinction β of the air and its own light A. The range V = 3/β is the distance at which the contrast
has fallen to 5 % (WMO No. 8). Two independent facts are used:

- the *fit*: the strip of ground is A and one R per lane of cells; for every V of a grid, A and all R follow by
  linear least squares, and the likelihood of the rest is that of V. It contains both the vertical profile of
  the light (Hautière, Tarel, Lavenant, Aubert, Automatic fog detection and estimation of visibility distance
  through use of an onboard camera, Machine Vision and Applications 17, 2006) and the decay of the contrast
  across the road. The sky at the horizon shows A where it is even.

  Wet ground mirrors the sky: it gets lighter with distance, as in fog, but most of it within the first 20 m,
  and its lines keep their contrast. So R is R + M·F(ε), with the reflectance F of water (Fresnel) at the grazing
  angle ε of the line of sight and one M ≥ 0 for the whole strip.
- the *bound*: nothing has more contrast than black before A, so that a contrast C at the distance d refutes
  every range below 3·d/ln(1/C). It is taken on the ground, and above the horizon between the sides of the lane
  at the distance d, where nothing nearer stands. Trees, houses and clouds ahead refute fog in clear air."""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from perception.sight.settings import AirSettings
from perception.sight.strip import Ground, Path
from trepid.car.camera import Camera
from trepid.types import Array, Floats

WATER_INDEX = 1.33  # of refraction
TINY = 1e-12
DARKEST = 0.004  # linear light: a sixteenth of grey 255
LEAST_CELLS = 24  # for a fit
SKY_NOISE = 1.5  # times the noise of a cell
DIM_SKY = 1.2  # share of the darkest ground, below which the sky is no airlight
LEAST_CONTRAST = 0.05  # of a thing that counts as seen (Koschmieder, WMO)
MOST_CONTRAST = 0.95
SIGMAS = 3.0  # by which a contrast exceeds the noise
LOWEST, HIGHEST = 0.1, 0.9  # quantiles of light in the corridor: single drops and flakes do not count


class Range(NamedTuple):
    """The optical range of the air."""

    range_m: float
    sigma: float  # standard deviation of its logarithm


class Sky(NamedTuple):
    """Light above the horizon: around the end of the road, and of the brightest tenth of the whole."""

    level: float
    unevenness: float  # standard deviation
    brightest: float


class AirFit:
    """Fits of the air with one camera: the grid of ranges, and what it shares between frames."""

    def __init__(self, camera: Camera, distance_m: Array, settings: AirSettings, *, reach_m: float) -> None:
        """``distance_m``: of the bands of the strip; ``reach_m``: a longer range need not be known."""
        self._camera, self._settings, self._reach_m = camera, settings, reach_m
        self._log_range = np.linspace(math.log(settings.least_m), math.log(settings.most_m), settings.steps)
        passed = np.exp(-3 * np.exp(-self._log_range)[:, None] * distance_m)
        # Every range with every unevenness of the road: (ranges · unevennesses, bands).
        self._passed = np.tile(passed, (len(settings.unevenness), 1))
        self._uneven = np.repeat(np.array(settings.unevenness), settings.steps)[:, None]
        self._mirrored = self._passed * reflectance_of_water(np.arctan2(camera.height_m, distance_m))

    def range_of(self, light: Floats, sky: Sky | None, ground: Ground, path: Path) -> Range | None:
        """The range in a frame of linear ``light``; None where the ground is not seen."""
        if np.count_nonzero(ground.seen) < LEAST_CELLS:
            return None
        near = ground.near
        if len(near) < LEAST_CELLS // 4:
            return None
        settings = self._settings
        top = max(float(near.mean()), sky.level if sky else 0.0, DARKEST)
        bound = max(self._ground_bound_m(ground, top), self._sky_bound_m(light, path, top))
        if bound >= self._reach_m:
            return Range(min(bound, settings.most_m), settings.corridor_sigma)
        if sky is not None and sky.level < DIM_SKY * _quantile(near, LOWEST):
            fit = Range(
                settings.most_m, settings.corridor_sigma
            )  # a dark sky scatters no light into the view
        else:
            fit = self._fit(ground, sky, top)
        if bound > fit.range_m:
            return Range(min(bound, settings.most_m), settings.corridor_sigma)
        return fit

    def _fit(self, ground: Ground, sky: Sky | None, top: float) -> Range:
        """Mean and deviation of the logarithm of the range, under a prior that is even in it."""
        settings, seen = self._settings, ground.seen.astype(float)
        noise, passed, mirrored, airy = settings.noise * top, self._passed, self._mirrored, 1 - self._passed
        weight = 1 / ((self._uneven * settings.reflectance * top * passed) ** 2 + noise**2)
        prior = (settings.reflectance_sigma * top) ** -2
        expected = settings.reflectance * top
        light = seen * ground.light
        rr = (passed**2 * weight) @ seen + prior
        ra, rm = (passed * airy * weight) @ seen, (passed * mirrored * weight) @ seen
        rl = (passed * weight) @ light + prior * expected
        ll = weight @ (light * ground.light) + prior * expected**2
        # Of A and M, once every R is eliminated: quadratic, linear and constant terms of the sum of squares.
        known, level = (0.0, 0.0) if sky is None else (self._weight_of(sky, noise), sky.level)
        aa = ((airy**2 * weight) @ seen - ra**2 / rr).sum(axis=1) + known
        am = ((airy * mirrored * weight) @ seen - ra * rm / rr).sum(axis=1)
        mm = ((mirrored**2 * weight) @ seen - rm**2 / rr).sum(axis=1) + (settings.mirror_sigma * top) ** -2
        al = ((airy * weight) @ light - ra * rl / rr).sum(axis=1) + known * level
        ml = ((mirrored * weight) @ light - rm * rl / rr).sum(axis=1)
        mirror = np.maximum(aa * ml - am * al, 0.0) / np.maximum(aa * mm - am**2, TINY)
        airlight = (al - am * mirror) / np.maximum(aa, TINY)
        constant = (ll - rl**2 / rr).sum(axis=1) + known * level**2
        rest = constant - 2 * (airlight * al + mirror * ml)
        rest += airlight**2 * aa + 2 * airlight * mirror * am + mirror**2 * mm
        spread = -np.log(weight) @ seen.sum(axis=1) + np.log(rr).sum(axis=1)
        score = -0.5 * (rest + spread) * settings.independent / seen.sum()
        likely = np.exp(score - score.max()).reshape(len(settings.unevenness), -1).sum(axis=0)
        likely /= likely.sum()
        mean = float(likely @ self._log_range)
        variance = float(likely @ (self._log_range - mean) ** 2)
        return Range(math.exp(mean), math.sqrt(variance + settings.model_sigma**2))

    @staticmethod
    def _weight_of(sky: Sky, noise: float) -> float:
        return 1 / (sky.unevenness**2 + (SKY_NOISE * noise) ** 2)

    def sky(self, light: Floats, path: Path) -> Sky | None:
        """The sky around the end of the road; None where the image does not show it."""
        settings, camera = self._settings, self._camera
        half_px = settings.sky_side_rad * camera.fx_px
        part = self._above(
            light, self._columns(path, path.x_m.max(keepdims=True))[0], half_px, settings.sky_up_rad
        )
        if part.size == 0:
            return None
        whole = light[: math.floor(camera.horizon_row_px) : 4, ::4]
        return Sky(float(np.median(part)), float(part.std()), _quantile(whole, HIGHEST))

    def _ground_bound_m(self, ground: Ground, top: float) -> float:
        """Least range [m] that the contrasts across the strip allow."""
        light, noise = ground.light, SIGMAS * self._settings.noise * top
        highest = np.where(ground.seen, light, -np.inf).max(axis=1)
        lowest = np.where(ground.seen, light, np.inf).min(axis=1)
        return float(_least_range(ground.distance_m, (highest - lowest - noise) / top).max())

    def _sky_bound_m(self, light: Floats, path: Path, top: float) -> float:
        """Least range [m] that the contrasts above the horizon, within the sides of the lane, allow."""
        settings, camera = self._settings, self._camera
        contrasts = np.zeros(len(settings.corridor_m))
        columns_px = self._columns(path, camera.x_m + self._corridor_m)
        for i, ahead_m in enumerate(settings.corridor_m):
            half_px = settings.corridor_half_m * camera.fx_px / ahead_m
            up_rad = max(settings.corridor_up_m / ahead_m, settings.sky_up_rad / 2)
            part = self._above(light, columns_px[i], half_px, up_rad)
            if part.size >= LEAST_CELLS:
                low, high = _quantile(part, LOWEST), _quantile(part, HIGHEST)
                noise = SIGMAS * settings.noise * max(high, top)
                contrasts[i] = (high - low - noise) / max(high, top)
        return float(_least_range(self._corridor_m, contrasts).max())

    @cached_property
    def _corridor_m(self) -> Array:
        return np.array(self._settings.corridor_m)

    def _columns(self, path: Path, x_m: Array) -> list[float]:
        """Columns of the lane at ``x_m``, kept within the image."""
        camera = self._camera
        columns = np.nan_to_num(path.column_at(x_m), nan=camera.cx_px)
        return np.clip(columns, 0, camera.width_px - 1).tolist()

    def _above(self, light: Floats, column_px: float, half_px: float, up_rad: float) -> Floats:
        """The pixels from the row above the horizon on, ``up_rad`` high; empty without sky in the image."""
        last = math.floor(self._camera.horizon_row_px)
        first = max(last - math.ceil(up_rad * self._camera.fy_px), 0)
        left, right = max(math.floor(column_px - half_px), 0), math.ceil(column_px + half_px) + 1
        return light[first : max(last, 0), left:right]


def reflectance_of_water(grazing_rad: Array) -> Array:
    """Share of unpolarised light that still water reflects at an angle to its surface (Fresnel 1823)."""
    out, within = np.sin(grazing_rad), np.sqrt(1 - (np.cos(grazing_rad) / WATER_INDEX) ** 2)
    across = (out - WATER_INDEX * within) / (out + WATER_INDEX * within)
    along = (within - WATER_INDEX * out) / (within + WATER_INDEX * out)
    return np.asarray((across**2 + along**2) / 2)


def _quantile(values: Floats | Array, share: float) -> float:
    """The value that ``share`` of ``values`` lie below."""
    place = int(share * (values.size - 1))
    return float(np.partition(values, place, axis=None)[place])


def _least_range(distance_m: Array, contrast: Array) -> Array:
    """3·d/ln(1/C) [m]; 0 where the contrast is not seen."""
    limited = np.clip(contrast, 1e-6, MOST_CONTRAST)
    return np.where(contrast >= LEAST_CONTRAST, 3 * distance_m / np.log(1 / limited), 0.0)
