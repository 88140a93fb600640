"""Masks as a picture of a clean road, which the lane finders of ``cv`` read as they read a camera image.

One owner thus decides which boundaries are those of the own lane, fits and rates them. Drivable area is grey, the
rest green, with the mixed colour where the mask is undecided, so that the edge of the road lies where the
probability is one half. Lines are light ridges of two pixels along the crest of their mask, as light as they are
probable. A mask marks a line some pixels wide at every distance, so that its crest, and not its width, is the line.

**Faint lines.** A network states the probability of a pixel, and few pixels show lines. Where it is unsure of far
dashes or of worn paint, it states some per mille, but still a hundred times as much as for the road beside them: a
crest is a line far more often than its pixels are. With the probability p of the pixel, that of the crest is

    σ(logit(p)/2 + 3/2)

so that p = 0.005, 0.05 and 0.5 count as 0.2, 0.5 and 0.8. On drawn roads, 0.7, 0.8 and 0.9 of the crests with
these p that lie on a boundary of the lane or inside it are on a boundary; real roads have joints and cracks too.
Without its faint dashes a road for both ways would be one lane.

**Surface.** A lane is right only where a car may drive on all of it. Its probability is thus at most that of each
of its pixels to be drivable, and so at most their mean: a pavement between a kerb and a line is no lane, however
clear both are. Near pixels are the most, so that what drives ahead, and hides the lane, hides few of them.

**Junctions.** A road is some lanes wide; where roads meet, the surface opens to the sides. Its width is measured
from 6 to 25 m ahead: the image shows less than a road nearer, and too few rows of it farther away.
"""

import cv2
import numpy as np

from perception.segments.network import Masks
from trepid.car.camera import Camera
from trepid.messages import PixelPath
from trepid.types import Floats, Image

AREA, REST, LINE = np.array([[100, 100, 100], [20, 64, 30], [255, 255, 255]], np.float32)  # BGR
SMOOTH_PX = 5  # along a row, before its crests are taken
LEAST = 0.2  # probability of a crest
EVIDENCE, PRIOR = 0.5, 1.5  # of the logit of a pixel in that of a crest; the logit of a crest at p = 1/2
LEAST_PIXEL = 1e-7  # of a probability whose logit is taken
BONNET = 1 / 2  # of the rows of a lane, the most that the own bonnet hides
OPEN_FROM_M, OPEN_TO_M = 6.0, 25.0  # ahead of the camera, where the surface is measured across
AHEAD = 0.02  # half the width of the strip straight ahead, in widths of the picture


def draw_masks(masks: Masks) -> Image:
    """The picture of ``masks``, (h, w, 3) uint8 BGR."""
    lines, area = masks.lines, masks.area
    shape = (lines if lines is not None else area).shape  # type: ignore[union-attr]
    road = np.ones(shape, np.float32) if area is None else area
    if lines is not None:
        road = np.maximum(road, lines)  # a line lies on the road
    picture = _mix_colours(AREA, REST, road)
    if lines is not None:
        picture = _mix_colours(LINE, picture, crests(crest_probability(lines)))
    return picture.astype(np.uint8)


def drivable_share(area: Floats, left: PixelPath, right: PixelPath) -> float:
    """Mean probability 0..1 of drivable ``area``, (h, w), between two boundaries in its pixels; 0 of no lane.

    The lowest rows do not count as long as nothing straight ahead is drivable: there the own bonnet is seen.
    """
    if not (left and right):
        return 0.0
    rows, across = (np.arange(size) for size in area.shape)
    first, last = (
        np.interp(rows, y, x, np.nan, np.nan) for x, y in (np.array(p)[::-1].T for p in (left, right))
    )
    lane = (across >= first[:, None]) & (across <= last[:, None])  # False for NaN
    rows = np.flatnonzero(lane.any(axis=1))
    ahead = np.abs(across / len(across) - 1 / 2) < AHEAD
    hidden = np.cumprod(area[rows][::-1, ahead].mean(axis=1) < 1 / 2).sum()
    rows = rows[: len(rows) - min(hidden, int(BONNET * len(rows)))]
    return float(area[rows][lane[rows]].mean()) if len(rows) else 0.0


def surface_width(area: Floats, camera: Camera) -> float:
    """The greatest width [m] of drivable ``area``, (h, w), across the straight way ahead; 0 without any there.

    In the row v below the horizon v₀ of a level road a pixel is h/(v - v₀) wide, by the height h of ``camera``.
    """
    camera, middle = camera.resize(*area.shape[::-1]), area.shape[1] // 2
    scale_m = camera.height_m / np.maximum(np.arange(len(area)) - camera.horizon_row_px, 1e-6)
    band = np.abs(scale_m * camera.fx_px - (OPEN_FROM_M + OPEN_TO_M) / 2) <= (OPEN_TO_M - OPEN_FROM_M) / 2
    wall = area[band] < 1 / 2
    sides = wall[:, middle:], wall[:, :middle][:, ::-1]
    free_px = sum(np.where(side.any(axis=1), side.argmax(axis=1), side.shape[1]) for side in sides)
    return float(np.max(scale_m[band] * free_px * ~wall[:, middle], initial=0.0))


def crest_probability(lines: Floats) -> Floats:
    """The probability that a crest is a line, from that of its pixel: o^a·e^b/(1 + o^a·e^b) with the odds o."""
    odds = np.clip(lines, LEAST_PIXEL, 1 - LEAST_PIXEL)
    odds = np.float32(np.exp(PRIOR)) * (odds / (1 - odds)) ** np.float32(EVIDENCE)
    return np.asarray(odds / (1 + odds), np.float32)


def crests(lines: Floats) -> Floats:
    """``lines`` at its crests along each row, and one pixel beside; 0 elsewhere."""
    smooth = cv2.blur(lines, (SMOOTH_PX, 1))
    middle = smooth[:, 1:-1]
    highest = (middle >= smooth[:, :-2]) & (middle > smooth[:, 2:]) & (middle > LEAST)
    found = np.zeros_like(lines)
    found[:, 1:-1] = np.where(highest, lines[:, 1:-1], 0.0)
    return np.asarray(cv2.dilate(found, np.ones((1, 2), np.uint8)), np.float32)


def _mix_colours(one: Floats, other: Floats, share: Floats) -> Floats:
    """``share`` of the colour ``one``, the rest of ``other``."""
    weight = cv2.merge([share] * 3)  # three equal planes multiply faster than one that is spread
    mixed = weight * (one - other)
    mixed += other
    return np.asarray(mixed, np.float32)
