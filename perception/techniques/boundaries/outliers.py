"""Removal of features that are no boundary (inventory A02, B01, B06, B12, B13)."""

import math
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.cluster.hierarchy import fcluster, linkage

from perception.techniques.image.picture import Boundaries, Evidence, FeatureKind, Features, GroundView
from perception.techniques.image.region import near
from perception.techniques.image.rows import width_px
from perception.techniques.image.surface import patch
from trepid.types import Array, Mask, NonNegative, Positive

HALF = 0.5  # response of a region above which a pixel is road
SOLID = 0.75  # least share of road pixels in a road; the rest are markings, cracks and shadows
MIDDLE_M = 6.0  # where lines are compared
MOST_PIECES = 400  # the cost of the hierarchy is quadratic


def near_prediction(
    evidence: Evidence, *, half_width_m: Positive = 0.4, growth: NonNegative = 0.02
) -> Features:
    """Features within ``half_width_m`` + ``growth``·x of the boundaries of the last frame (A02).

    All features while a side is unknown. Limit: a boundary that jumps.
    """
    if evidence.predicted is None or evidence.predicted.side_count < 2:
        return evidence.features
    return evidence.features.where(
        near(evidence.view, evidence.predicted, half_width_m=half_width_m, growth=growth)
    )


def along_road(
    evidence: Evidence,
    *,
    max_heading_rad: Annotated[float, Field(gt=0, lt=1.5)] = 0.4,
    min_length_m: Positive = 1.0,
) -> Features:
    """Connected pieces along the road: within ``max_heading_rad`` of ahead, ``min_length_m`` long (B06).

    The direction is that of the line y(x) through the piece on the road; the printed slope limit in the picture
    would remove the outer lines of a wide road. Source: R [56]. Limit: sharp bends as one piece.
    """
    labels, pieces = _pieces(evidence)
    good = [
        number
        for number, ground in pieces
        if np.ptp(ground[:, 0]) >= min_length_m and abs(math.atan(_line(ground)[1])) <= max_heading_rad
    ]
    return evidence.features.where(np.isin(labels, good))


def as_wide_as_paint(evidence: Evidence, *, widest_m: Positive = 0.4, least_px: Positive = 2.5) -> Features:
    """Runs of a row no wider than ``widest_m`` on the road; removes arrows, zebras, patches, glare (B12 guard).

    Runs up to ``least_px`` are always kept: far paint is as thin as an edge. Limit: text in thin strokes.
    """
    high = evidence.features.response > 0
    limit = np.maximum(width_px(evidence.view, widest_m), least_px)[:, None]
    return evidence.features.where(high & (_run_lengths(high) <= limit))


def middle_to_side(evidence: Evidence, *, step_m: Positive = 0.35, from_m: Positive = 0.3) -> Features:
    """In every row the first response left and right of the middle that continues the row below (B12).

    The scan goes from near to far and starts ``from_m`` beside the middle of the predicted lane, or before the
    vehicle. A row links within ``step_m`` of the row below on the road, + 0.2 m a metre of gap. Source: R [72].
    Limit: a second line on the same side; an arrow in the middle, which blocks a side without a line.
    """
    high = evidence.features.response > 0
    kept = np.zeros_like(high)
    for sign in (1, -1):
        rows, columns = _link_pixels(high, evidence.view, _middle(evidence.predicted), sign, step_m, from_m)
        kept[rows, columns] = True
    return evidence.features.where(kept)


def clusters(
    evidence: Evidence, *, join_m: Positive = 0.35, join_rad: Positive = 0.12, min_length_m: Positive = 3.0
) -> Features:
    """Pieces joined to lines by their place and heading, without lines shorter than ``min_length_m`` (B06).

    Agglomerative clustering, single linkage, of (place at 6 m / ``join_m``, heading / ``join_rad``), cut at 1; the
    length of a line is the sum of its pieces ahead. Source: R [56]. Limit: a single short dash.
    """
    labels, pieces = _pieces(evidence)
    pieces = [(number, ground) for number, ground in pieces if np.ptp(ground[:, 0]) > 0.1][:MOST_PIECES]
    if not pieces:
        return evidence.features.where(np.zeros(labels.shape, bool))
    lines = [_line(ground) for _, ground in pieces]
    lengths = np.array([np.ptp(ground[:, 0]) for _, ground in pieces])
    spaced = np.array([[(a + b * MIDDLE_M) / join_m, math.atan(b) / join_rad] for a, b in lines])
    group = fcluster(linkage(spaced, "single"), 1.0, "distance") if len(pieces) > 1 else np.array([1])
    total = np.bincount(group, weights=lengths)
    good = [number for (number, _), own in zip(pieces, group, strict=True) if total[own] >= min_length_m]
    return evidence.features.where(np.isin(labels, good))


def patch_component(evidence: Evidence, *, close_m: Positive = 0.3) -> Features:
    """The connected part of a region below the vehicle; gaps of a row up to ``close_m`` are closed (B13).

    Source: R 1.2. Limit: a connected side road or pavement.
    """
    response, view = evidence.features.response, evidence.view
    road = response > HALF
    between = (
        np.logical_or.accumulate(road, axis=1) & np.logical_or.accumulate(road[:, ::-1], axis=1)[:, ::-1]
    )
    gap = between & ~road
    road |= gap & (_run_lengths(gap) <= width_px(view, close_m)[:, None])  # lines and cracks
    road = cv2.morphologyEx(road.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    labels = np.asarray(cv2.connectedComponents(road.astype(np.uint8), connectivity=4)[1])
    below = labels[patch(view) & road]
    nothing = np.zeros(road.shape, bool)
    whole = _fill_holes(labels == np.bincount(below).argmax()) if len(below) else nothing
    if not len(below) or np.mean(response[whole] > HALF) < SOLID:  # noise is mostly holes
        return evidence.features.where(nothing)
    return Features(whole.astype(np.float32), FeatureKind.REGION)


def outline(evidence: Evidence) -> Features:
    """The left and the right border of a region in every row, as line features (B13).

    In each row the run of road at, or next to, the middle of the run below. A border of the picture is no border of
    the road. Limit: the road beyond a vehicle that covers its full width.
    """
    view = evidence.view
    road = evidence.features.response > HALF
    line = np.zeros(road.shape, np.uint8)
    middle = _middle(evidence.predicted)
    column = math.nan
    for row in np.flatnonzero(np.isfinite(view.pixel_m))[::-1]:
        runs = _runs(road[row])
        if not len(runs):
            continue
        if math.isnan(column):
            column = float(view.pixels([(max(float(view.ahead_m[row]), 0.1), middle)])[0, 0])
        gap = np.maximum(np.maximum(runs[:, 0] - column, column - runs[:, 1]), 0)
        first, last = runs[int(np.argmin(gap))]
        if first > 0:
            line[row, first] = 255
        if last < road.shape[1] - 1:
            line[row, last] = 255
        column = (first + last) / 2
    if view.seen is not None:  # nor is the border of the camera image
        line[cv2.erode(view.seen.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0] = 0
    return Features(line, FeatureKind.LINE)


def _pieces(evidence: Evidence) -> tuple[NDArray[np.int32], list[tuple[int, Array]]]:
    """Connected pieces: their label image, and number and road points (x, y), shape (n, 2), of each."""
    high = (evidence.features.response > 0).astype(np.uint8)
    count, labels = cv2.connectedComponents(high, connectivity=8)
    rows, columns = np.nonzero(labels)
    ground = evidence.view.ground(np.column_stack([columns, rows]))
    finite = np.isfinite(ground).all(axis=1)
    number = labels[rows, columns][finite]
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number, minlength=count))
    parts = np.split(ground[finite][order], ends[:-1])
    return np.asarray(labels, np.int32), [(i, part) for i, part in enumerate(parts) if len(part) > 1]


def _line(ground: Array) -> tuple[float, float]:
    """Least-squares y = a + b·x of road points."""
    x, y = ground.T
    spread = float(np.var(x))
    b = float(np.mean((x - x.mean()) * (y - y.mean())) / max(spread, 1e-6))
    return float(y.mean()) - b * float(x.mean()), b


def _runs(row: Mask) -> NDArray[np.int64]:
    """First and last column of each run of True, shape (n, 2)."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    return np.asarray(change.reshape(-1, 2) - [0, 1], np.int64)


def _run_lengths(high: Mask) -> NDArray[np.int64]:
    """For every pixel the length of its run of True in the row; 0 outside of runs."""
    flat = np.pad(high, ((0, 0), (1, 1))).ravel()
    change = np.flatnonzero(np.diff(flat.astype(np.int8)))
    lengths = np.zeros(flat.size, np.int64)
    for first, last in change.reshape(-1, 2):
        lengths[first + 1 : last + 1] = last - first
    return lengths.reshape(high.shape[0], -1)[:, 1:-1]


def _middle(predicted: Boundaries | None) -> float:
    """y of the middle of the predicted lane before the vehicle; 0 without a prediction."""
    if predicted is None or predicted.left is None or predicted.right is None:
        return 0.0
    return float(predicted.left.y_m[0] + predicted.right.y_m[0]) / 2


def _link_pixels(
    high: Mask, view: GroundView, middle_m: float, sign: int, step_m: float, from_m: float
) -> tuple[list[int], list[int]]:
    """Rows and columns of one side, ``sign`` +1 for left."""
    rows: list[int] = []
    columns: list[int] = []
    last: Array | None = None
    for row in np.flatnonzero(np.isfinite(view.pixel_m))[::-1]:
        found = np.flatnonzero(high[row])
        if not len(found):
            continue
        ground = view.ground(np.column_stack([found, np.full(len(found), row)]))
        aside = sign * (ground[:, 1] - middle_m)
        if last is None:
            good = np.flatnonzero(aside > from_m)
        else:
            far = step_m + 0.2 * abs(float(ground[0, 0] - last[0]))
            good = np.flatnonzero(np.abs(ground[:, 1] - last[1]) < far)
        if len(good):
            best = good[np.argmin(aside[good] if last is None else np.abs(ground[good, 1] - last[1]))]
            rows.append(int(row))
            columns.append(int(found[best]))
            last = ground[best]
    return rows, columns


def _fill_holes(region: Mask) -> Mask:
    """The region with its holes filled."""
    contours, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    full = np.zeros(region.shape, np.uint8)
    cv2.drawContours(full, contours, -1, 1, cv2.FILLED)
    return full > 0
