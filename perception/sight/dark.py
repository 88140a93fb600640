"""Darkness: the distance at which a target on the ground no longer stands out of the noise of the image.

A square target, whose light is ``target_ratio`` times that of the ground, differs from ground of the grey level
g by g·(√ratio - 1). It is seen while this difference, averaged over its n pixels, exceeds the noise σ of a
pixel by the factor k (Rose, J. Opt. Soc. Am. 38, 1948):

    g(d)·(√ratio - 1)·√n(d) / σ ≥ k,    n = fx·fy·(side/d)²

The noise is measured in the image itself, where the ground is most even. Where lamps light the road, so that
the sky is darker than the ground ahead, a target smaller than a pixel loses n instead of √n.
"""

import math
from enum import StrEnum

import numpy as np

from perception.sight.air import Sky
from perception.sight.settings import DarkSettings
from perception.sight.strip import Ground
from trepid.car.camera import Camera
from trepid.types import Array, Image

BLOCK_PX = (8, 16)  # rows and columns over which the noise is averaged
EVEN_SHARE = 0.5  # quantile of the blocks: structures of the ground add to the others
# Second differences of white noise deviate √6 times as much; the mean of their size is √(2/π) of that.
SIGMA_OF_MEAN = math.sqrt(math.pi / 2) / math.sqrt(6)
LAMPLIGHT = 0.5  # most linear light that the lamps of a car give bright concrete
DUSK_SKY = 0.25  # most linear light of the sky at dusk: half of white on the grey scale
DIM = 0.06  # linear light of ground: a quarter of white on the grey scale
LANE_HALF_M = 2.0  # of the ground whose light counts


def noise_grey(ground: Image, *, least: float) -> float:
    """Standard deviation of the noise of a pixel [grey levels] in the rows of ``ground``, at least ``least``."""
    values = ground[::2].astype(np.int16)
    size = np.abs(values[:, 2:] - 2 * values[:, 1:-1] + values[:, :-2])
    rows, columns = (n // block * block for n, block in zip(size.shape, BLOCK_PX, strict=True))
    if not rows or not columns:
        return least
    blocks = size[:rows, :columns].reshape(
        rows // BLOCK_PX[0], BLOCK_PX[0], columns // BLOCK_PX[1], BLOCK_PX[1]
    )
    means = np.sort(blocks.mean(axis=(1, 3)), axis=None)
    return max(SIGMA_OF_MEAN * float(means[int(EVEN_SHARE * len(means))]), least)


class Lighting(StrEnum):
    """Where the light on the road comes from."""

    DAY = "day"
    DUSK = "dusk"  # little light, from a dim sky
    LAMPS = "lamps"  # the ground ahead is lighter than the sky


def lighting(ground: Ground, sky: Sky | None) -> Lighting:
    """The lighting of ``ground`` under ``sky``."""
    near = ground.near
    level = float(near.mean()) if len(near) else 0.0
    if sky is not None and sky.brightest < level < LAMPLIGHT:
        return Lighting.LAMPS
    is_dim = level < DIM and (sky is None or sky.brightest < DUSK_SKY)
    return Lighting.DUSK if is_dim else Lighting.DAY


def dark_m(
    ground: Ground, middle_m: Array, noise: float, camera: Camera, settings: DarkSettings, *, by_lamps: bool
) -> float:
    """Distance from the lens [m] at which the target is lost; infinite where the image shows it to the last band.

    ``middle_m``: of the cells, across the lane. ``by_lamps``: the ground is lighter than the sky.
    """
    lane = ground.seen & (np.abs(middle_m) <= LANE_HALF_M)
    count = lane.sum(axis=1)
    known = count > 0
    if not known.any():
        return math.inf
    light = (ground.light * lane).sum(axis=1)[known] / count[known]
    distance_m = ground.distance_m[known][::-1]  # from near to far
    grey = 255 * np.sqrt(np.maximum(light[::-1], 0.0))
    side_px = settings.target_side_m * math.sqrt(camera.fx_px * camera.fy_px) / distance_m
    gain = np.minimum(side_px, side_px**2) if by_lamps else side_px
    clarity = grey * (math.sqrt(settings.target_ratio) - 1) * gain / (noise * settings.noise_multiple)
    best = int(np.argmax(clarity))  # beams pass above the ground right before the car
    if clarity[best] < 1:
        return float(distance_m[0])
    lost = np.flatnonzero(clarity[best:] < 1)
    if len(lost) == 0:
        # Beyond the last band the ground is as light as there, and the target shrinks.
        return float(distance_m[-1] * clarity[-1] ** (0.5 if by_lamps else 1.0))
    at = best + int(lost[0])
    before, after = math.log(clarity[at - 1]), math.log(max(clarity[at], 1e-6))
    share = before / (before - after)
    return float(distance_m[at - 1] * (distance_m[at] / distance_m[at - 1]) ** share)
