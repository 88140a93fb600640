"""Paints the carriageway without markings: its edges, brightness, repairs, kerbs, puddles and snow."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.render.ground.strip_grid import (
    ROWS,
    Grid,
    Stretch,
    Textures,
    blend_fields,
    distance_along,
    edges_m,
)
from sim_harness.world.roads.appearance import Section, Surface
from sim_harness.world.roads.features import Side
from sim_harness.world.roads.lanes import centre_m
from sim_harness.world.roads.road import Road
from trepid.types import Array, Floats, Image

EDGE_SOFTNESS_M = 0.05
SURFACE_TINT = {
    Surface.ASPHALT: (0.99, 1.0, 1.0),
    Surface.CONCRETE: (0.94, 1.0, 1.03),
    Surface.GRAVEL: (0.80, 0.95, 1.08),
    Surface.FLOOR: (1.0, 1.0, 1.0),
}
GRAIN = {Surface.ASPHALT: 0.09, Surface.CONCRETE: 0.05, Surface.GRAVEL: 0.20, Surface.FLOOR: 0.0}
CONCRETE_SLAB_M = 5.0
BREAK_M = 0.6  # depth of the deepest piece broken off the edge
KERB_BGR, KERB_STONE_M = (168, 174, 176), 1.0
SNOW_BGR = (246, 240, 236)
SNOW_SOFTNESS_M = 0.12
SNOW_RAGGED_M = 0.35  # standard deviation of the rim of a bank, at most half its width
WET_DARKENING = 0.38  # of soaked asphalt: about half the albedo, Lekner & Dorf (1988)
PUDDLE_BGR = (150, 142, 134)  # reflection of a grey sky
WHEELS_M = (-0.75, 0.75)
SEAM_M, SEAM_DARKENING = 0.03, 0.4  # half width of a tar seam along the road
ROUGH_M = 0.5  # bound of the roughness of an edge


class SurfacePainter:
    """Paints the carriageway of a road without its markings."""

    def __init__(self, road: Road, grid: Grid, textures: Textures, *, tint: Array, seed: int) -> None:
        self._road, self._grid, self._textures, self._tint = road, grid, textures, tint
        rng = np.random.default_rng((seed, 5))
        self._rim = smooth_noise(rng, (4 * ROWS, 2), (64, 1))  # noise of broken edges and of snow banks
        self._is_wet = any(section.wet for section in road.sections)
        self._tracks = {id(section): self._wheel_tracks(section) for section in road.sections}
        self._seams = {id(section): self._seam_tone(section) for section in road.sections if section.seams_m}

    def mask(self, index: int, station: Array) -> Image:
        """Mask of carriageway and kerb of a block, with rough edges."""
        start = index * ROWS % len(self._rim)
        rough, rim = (noise[start : start + ROWS] for noise in (self._textures.edge, self._rim))
        amount = blend_fields(self._road, station, lambda section: section.edge_roughness_m)
        breaks = blend_fields(self._road, station, lambda section: section.edge_breaks)
        edges = []
        for side, sound in enumerate(edges_m(self._road, station)):
            edge = sound + amount * rough[:, side] + self._kerb(station, side)
            edges.append((edge - _bite(rim[:, side], breaks)).astype(np.float32))
        right, left = edges
        offset = self._grid.offsets.astype(np.float32)
        inside = left[:, None] - offset
        np.minimum(inside, offset + right[:, None], out=inside)
        start = index * ROWS % len(self._textures.blotch)
        inside += self._textures.blotch[start : start + ROWS] * np.float32(0.02)
        inside *= np.float32(255 / EDGE_SOFTNESS_M)
        inside += np.float32(127)
        return np.clip(inside, 0, 255, out=inside).astype(np.uint8)

    def paint(self, colour: Image, here: Stretch, rng: np.random.Generator) -> None:
        """Paint asphalt, concrete or gravel, with wear and wetness."""
        tone = self._tone(here, rng)
        if self._is_wet:
            tone *= (1 - WET_DARKENING * self._wet(here)).astype(np.float32)
        tint = np.array(SURFACE_TINT[here.section.surface]) * self._tint * (255 * here.section.surface_grey)
        for channel in range(3):
            colour[:, :, channel] = cv2.convertScaleAbs(tone, alpha=tint[channel])

    def cover(self, colour: Image, here: Stretch) -> None:
        """Paint kerbs, puddles and snow over the markings."""
        section = here.section
        if section.kerb_m:
            self._paint_kerbs(colour, here)
        if self._is_wet and (wet := self._wet(here)).any():
            long, fine = here.part(self._textures.wave), here.part(self._textures.blotch)
            puddles = np.clip((wet.astype(np.float32) - 2.1 - 0.9 * long - 0.05 * fine) / 0.15, 0, 0.8)
            _blend(colour, puddles * np.clip(5 * wet, 0, 1), PUDDLE_BGR)
        if section.snow_cover:
            self._paint_trodden_snow(colour, here)
        if section.snow_left_m or section.snow_right_m:
            self._paint_banks(colour, here)

    def _wet(self, here: Stretch) -> Array:
        """Wetness of each row, (rows, 1)."""
        return blend_fields(self._road, here.station, lambda section: section.wet)[:, None]

    def _tone(self, here: Stretch, rng: np.random.Generator) -> Floats:
        """Brightness of the bare carriageway around 1, (rows, columns)."""
        section, textures = here.section, self._textures
        tone = here.part(textures.wave) * np.float32(0.05 * (0.4 + section.patchiness))
        tone += here.part(textures.blotch) * np.float32(0.03)
        start = int(rng.integers(ROWS))
        tone += textures.grain[start : start + len(tone)] * np.float32(GRAIN[section.surface])
        tone += 1 + self._tracks[id(section)]
        if section.surface == Surface.CONCRETE:
            tone[here.station % CONCRETE_SLAB_M < 0.03] *= 0.65
        if section.surface != Surface.GRAVEL:
            _repair(tone, section.patchiness, rng)
        if section.seams_m:
            tone *= self._seams[id(section)]
        return tone

    def _seam_tone(self, section: Section) -> Floats:
        """Brightness of the seams along the road, per column."""
        offset = self._grid.offsets
        seams = sum(np.exp(-(((offset - place_m) / SEAM_M) ** 2)) for place_m in section.seams_m)
        return np.asarray(1 - SEAM_DARKENING * np.minimum(seams, 1.0), np.float32)

    def _wheel_tracks(self, section: Section) -> Floats:
        """Relative darkening by wheel tracks in all lanes, per column."""
        beside = (*range(1, len(section.left_lanes) + 1), *range(-len(section.right_lanes), 0))
        width_m = self._road.settings.lane_width_m
        centres = [0.0, *(sum(centre_m(section, lane, width_m)) / 2 for lane in beside)]
        offset = self._grid.offsets
        tracks = sum(np.exp(-(((offset - c - wheel) / 0.25) ** 2)) for c in centres for wheel in WHEELS_M)
        return np.asarray(-0.05 * tracks, np.float32)

    def _kerb(self, station: Array, side: int) -> Array:
        """Width of the kerb on the right (0) or left (1); 0 at side roads."""
        kerb = np.array([section.kerb_m for section in self._road.sections])
        if not kerb.any():
            return np.zeros(len(station))
        width = kerb[self._road.section_indices(station)]
        for junction in self._road.settings.junctions:
            if junction.side in (Side.BOTH, (Side.RIGHT, Side.LEFT)[side]):
                half_m = (junction.mouth_m[1] - junction.mouth_m[0]) / 2
                width = np.where(
                    np.abs(distance_along(self._road, station, junction.at_m)) < half_m, 0.0, width
                )
        return np.asarray(width, np.float64)

    def _paint_kerbs(self, colour: Image, here: Stretch) -> None:
        stone = 1 - 0.25 * (here.station % KERB_STONE_M < 0.04)[:, None]
        for side, sign, edge in _sides(edges_m(self._road, here.station)):
            columns = self._beyond(sign, edge, here.section.kerb_m)
            beyond = sign * self._grid.offsets[columns] > edge[:, None]
            has_kerb = self._kerb(here.station, side)[:, None] > 0
            _blend(colour[:, columns], (beyond & has_kerb).astype(np.float32), KERB_BGR, stone)

    def _beyond(self, sign: int, edge: Array, width_m: float) -> slice:
        """Columns from the innermost edge of one side to ``width_m`` beyond the outermost one, plus ROUGH_M."""
        ends = sign * (float(edge.min()) - ROUGH_M), sign * (float(edge.max()) + width_m + ROUGH_M)
        return self._grid.columns_between(min(ends), max(ends))

    def _paint_trodden_snow(self, colour: Image, here: Stretch) -> None:
        """Paint snow in soft patches, thinner in the wheel tracks."""
        rank = ndtr(0.5 * here.part(self._textures.blotch) + 0.87 * here.part(self._textures.wave))
        share = here.section.snow_cover * (
            1 + 12 * self._tracks[id(here.section)] * (1 - here.section.snow_cover)
        )
        _blend(colour, 0.9 * np.clip((share - rank) / 0.15 + 0.5 * (share > 0.98), 0, 1), SNOW_BGR)

    def _paint_banks(self, colour: Image, here: Stretch) -> None:
        """Paint banks of snow with a ragged rim along the edges."""
        rim, blotch = here.part(self._rim), here.part(self._textures.blotch)
        fields = (lambda section: section.snow_right_m), (lambda section: section.snow_left_m)
        for side, sign, edge in _sides(edges_m(self._road, here.station)):
            reach = blend_fields(self._road, here.station, fields[side])
            ragged = np.minimum(SNOW_RAGGED_M, reach / 2) * rim[:, side]
            inwards = edge - reach + ragged
            columns = self._beyond(sign, inwards, float((edge - inwards).max()))
            fine = blotch[:, columns]
            cover = (sign * self._grid.offsets[columns] - inwards[:, None] + 0.04 * fine) / SNOW_SOFTNESS_M
            cover = np.clip(cover, 0, 1) * (reach > 0)[:, None]
            _blend(colour[:, columns], cover, SNOW_BGR, 1 + 0.03 * fine)


def _sides(edges: tuple[Array, Array]) -> tuple[tuple[int, int, Array], tuple[int, int, Array]]:
    """Index, sign of the offsets and edge of the right and the left side."""
    return (0, -1, edges[0]), (1, 1, edges[1])


def _blend(
    colour: Image,
    cover: NDArray[np.floating],
    bgr: tuple[int, int, int],
    tone: NDArray[np.floating] | float = 1.0,
) -> None:
    """Blend one colour, times ``tone``, into a block by ``cover`` (rows, columns)."""
    columns = np.flatnonzero(cover.any(axis=0))
    if not len(columns):
        return
    part = slice(int(columns[0]), int(columns[-1]) + 1)
    share = cover[:, part].astype(np.float32)
    tone = np.broadcast_to(np.asarray(tone, np.float32), cover.shape)[:, part]
    for channel in range(3):
        bare = colour[:, part, channel].astype(np.float32)
        colour[:, part, channel] = np.clip(bare + share * (bgr[channel] * tone - bare), 0, 255)


def _bite(rim: Floats, share: Array) -> Array:
    """Depth of the pieces broken off the edge [m]."""
    if not share.any():
        return share
    depth = np.clip((rim - ndtri(1 - np.clip(share, 1e-6, 1 - 1e-6))) / 0.8, 0, 1)
    return np.asarray(BREAK_M * depth * (share > 0), np.float64)


def _repair(tone: Floats, patchiness: float, rng: np.random.Generator) -> None:
    """Draw patches, tar seams and cracks into ``tone``."""
    rows, columns = tone.shape
    for _ in range(rng.poisson(3 * patchiness * rows / ROWS)):
        row, column = int(rng.integers(rows)), int(rng.integers(columns))
        height, width = int(rng.uniform(20, 160)), int(rng.uniform(15, 70))
        patch = tone[row : row + height, column : column + width]
        patch *= np.float32(rng.uniform(0.75, 1.2))
        cv2.rectangle(tone, (column, row), (column + width, row + height), 0.8, int(rng.integers(1, 3)))
    for _ in range(rng.poisson(8 * patchiness * rows / ROWS)):
        steps = rng.normal((0, 0), (4, 6), (int(rng.integers(8, 40)), 2)) + rng.normal(0, 4, 2)
        path = np.cumsum(steps, axis=0) + rng.uniform((0, 0), (columns, rows))
        cv2.polylines(tone, [path.astype(np.int32)], False, float(rng.uniform(0.5, 0.8)), 1)
