"""The part of the picture that is processed (inventory A01–A03)."""

from dataclasses import replace

import numpy as np

from perception.techniques.image.picture import Boundaries, Boundary, GroundView, PixelBox, Region
from trepid.types import Array, Mask, NonNegative, Positive

MIN_PX = 16  # least height and width of a part


def roi_fixed(
    view: GroundView,
    predicted: Boundaries | None,
    speed_mps: float | None,
    *,
    reach_m: Positive = 40.0,
    margin_px: Positive = 6.0,
) -> Region:
    """The picture from ``margin_px`` above the horizon down; features count up to ``reach_m`` ahead (A01).

    y ≥ y_horizon − margin: the junction of the boundaries lies inside. Source: R II.A, [7]. Limit: hills.
    """
    near = _rows(view, reach_m)
    junction_px = view.horizon_px - margin_px if np.isfinite(view.horizon_px) else near.top_px
    box = replace(near, top_px=max(0, min(near.top_px, int(junction_px))))
    mask = np.zeros((view.height_px, view.width_px), bool)
    mask[near.rows] = True
    return Region(box, mask)


def roi_tracked(
    view: GroundView,
    predicted: Boundaries | None,
    speed_mps: float | None,
    *,
    reach_m: Positive = 40.0,
    half_width_m: Positive = 0.5,
    growth: NonNegative = 0.02,
) -> Region:
    """Bands around the two boundaries of the last frame; without them all rows up to ``reach_m`` (A02).

    |y − y_b(x)| < ``half_width_m`` + ``growth``·x on the road; the growth covers a heading error of about a
    degree. Source: R II.A. Limit: a boundary that jumps, such as a new lane, until it is lost.
    """
    box = _rows(view, reach_m)
    if predicted is None or predicted.side_count < 2:  # the missing side may be anywhere
        return Region(box)
    mask = near(view, predicted, half_width_m=half_width_m, growth=growth)
    mask[: box.top_px] = False
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) < MIN_PX or len(columns) < MIN_PX:
        return Region(box)  # the prediction has left the picture
    return Region(PixelBox(int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1), mask)


def roi_speed(
    view: GroundView,
    predicted: Boundaries | None,
    speed_mps: float | None,
    *,
    seconds: Positive = 2.5,
    min_reach_m: Positive = 15.0,
    max_reach_m: Positive = 60.0,
    half_width_m: Positive = 0.5,
    growth: NonNegative = 0.02,
) -> Region:
    """The road of the next ``seconds``, in bands around the boundaries of the last frame (A03, DROI).

    reach = v·t, within limits; ``max_reach_m`` for an unknown speed. Source: R Tab. 2 [76]. Limit: bends farther
    ahead at low speed.
    """
    known_m = max_reach_m if speed_mps is None else speed_mps * seconds
    reach_m = min(max(known_m, min_reach_m), max_reach_m)
    return roi_tracked(view, predicted, None, reach_m=reach_m, half_width_m=half_width_m, growth=growth)


def near(view: GroundView, boundaries: Boundaries, *, half_width_m: float, growth: float) -> Mask:
    """Pixels within ``half_width_m`` + ``growth``·x of one of the boundaries, extended straight at both ends."""
    rows = np.arange(view.height_px, dtype=float)
    columns = np.arange(view.width_px, dtype=float)
    mask = np.zeros((view.height_px, view.width_px), bool)
    reach_px = (half_width_m + growth * np.maximum(view.ahead_m, 0)) / view.pixel_m
    for side, _ in boundaries.signed_sides:
        pixels = view.pixels(_extend_side(side))
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if not len(pixels):
            continue
        order = np.argsort(pixels[:, 1])
        middle = np.interp(rows, pixels[order, 1], pixels[order, 0])
        with np.errstate(invalid="ignore"):  # rows above the horizon are NaN: not near
            mask |= np.abs(columns - middle[:, None]) < reach_px[:, None]
    return mask


def _extend_side(side: Boundary, *, near_m: float = 0.5, far_m: float = 100.0) -> Array:
    """Points (x, y) of the boundary, with its tangents at both ends drawn on."""
    x, y = side.x_m, side.y_m
    step = max(1, len(x) // 4)
    first = (y[step] - y[0]) / max(x[step] - x[0], 1e-6)
    last = (y[-1] - y[-1 - step]) / max(x[-1] - x[-1 - step], 1e-6)
    before = np.linspace(min(near_m, x[0] - 0.1), x[0] - 0.05, 10)
    beyond = np.linspace(x[-1] + 0.1, max(far_m, x[-1] + 1.0), 10)
    y_m = np.concatenate([y[0] + first * (before - x[0]), y, y[-1] + last * (beyond - x[-1])])
    return np.column_stack([np.concatenate([before, x, beyond]), y_m])


def _rows(view: GroundView, reach_m: float) -> PixelBox:
    rows = np.flatnonzero(view.ahead_m <= reach_m)
    top = int(rows[0]) if len(rows) else view.height_px
    return PixelBox(max(min(top, view.height_px - MIN_PX), 0), view.height_px, 0, view.width_px)
