"""The period of a dashed line in the image of a flat road.

A point of the road x ahead lies v = f·h/x rows below the horizon, so that dashes are equally long in 1/v; their
period there, times f·h, is that on the road.
"""

import numpy as np

from perception.camera.grey import grey
from trepid.messages import PixelPath
from trepid.types import Array, Image, Mask

LINE = 0.1  # distance of the edge of a line from its middle, over the rows below the horizon
BESIDE = (0.15, 0.3)  # ... of the road beside it
NEAR_HORIZON = 0.05  # of the width of the image: rows above show no single dashes
LEAST_STEP = 20.0  # grey levels between paint and gaps
STUD = 0.3  # of the length of the longest dash: shorter ones are reflectors


def dash_period(image: Image, path: PixelPath, horizon_px: float) -> float | None:
    """Period [1/px] of the line along ``path``, from near and far ends of dashes; None without two of a kind."""
    line = np.array(path, float).reshape(-1, 2)
    if len(line) < 2:
        return None
    line = line[np.argsort(line[:, 1])]
    first = max(line[0, 1], horizon_px + NEAR_HORIZON * image.shape[1])
    rows = np.arange(int(np.ceil(first)), min(int(line[-1, 1]) + 1, image.shape[0]))
    if len(rows) < 3:
        return None
    paint = _paint(grey(image), rows, np.interp(rows, line[:, 1], line[:, 0]), rows - horizon_px)
    shown = np.flatnonzero(np.isfinite(paint))
    if len(shown) < 3:
        return None
    part = slice(shown[0], shown[-1] + 1)  # a line may leave the image at its side
    rows, paint = rows[part], paint[part]
    smooth = np.median([paint[:-2], paint[1:-1], paint[2:]], axis=0)  # NaN beside NaN
    low, high = (np.nanmin(smooth), np.nanmax(smooth)) if np.isfinite(smooth).any() else (0.0, 0.0)
    if high - low < LEAST_STEP:
        return None
    edges = 1 / (np.append(rows, rows[-1] + 1) - 0.5 - horizon_px)
    far, near = _ends(paint > (low + high) / 2, edges)
    periods = [*-np.diff(far), *-np.diff(near)]
    return float(np.median(periods)) if periods else None


def _paint(image: Image, rows: Array, columns: Array, below_px: Array) -> Array:
    """By how many grey levels the line is lighter than the road on its darker side, by row; NaN outside."""
    paint = np.full(len(rows), np.nan)
    for number, (row, column, below) in enumerate(zip(rows, columns, below_px, strict=True)):
        pixels, reach = image[int(row)], LINE * below + 1

        def strip(start: float, end: float, pixels: Image = pixels) -> Image:
            return pixels[max(round(start), 0) : max(round(end) + 1, 0)]

        beside = [
            strip(column + side * BESIDE[side < 0] * below, column + side * BESIDE[side > 0] * below)
            for side in (-1, 1)
        ]
        line = strip(column - reach, column + reach)
        if len(line) and all(map(len, beside)):
            paint[number] = float(line.max()) - max(float(np.median(one)) for one in beside)
    return paint


def _ends(paint: Mask, edges: Array) -> tuple[list[float], list[float]]:
    """Places [1/px] of the far and of the near ends of dashes, from far to near, without reflectors.

    ``edges``: of the rows, one more than there are rows. A dash cut by the first or last row has one end.
    """
    turns = np.flatnonzero(np.diff(np.concatenate([[False], paint, [False]]).astype(np.int8)))
    runs = turns.reshape(-1, 2)  # first row, and the row after the last one
    lengths = edges[runs[:, 0]] - edges[runs[:, 1]]
    runs = runs[lengths > STUD * lengths.max(initial=0.0)]
    far = [float(edges[start]) for start, _ in runs if start > 0]
    near = [float(edges[end]) for _, end in runs if end < len(paint)]
    return far, near
