"""What is no boundary taken out of the features (inventory A02, B01, B06, B12, B13)."""

import math
from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.cluster.hierarchy import fcluster, linkage

from perception.techniques.image.picture import Boundaries, Features, Kind, View
from perception.techniques.image.region import near
from perception.techniques.image.rows import width_px
from perception.techniques.image.surface import patch
from trepid.types import Array, Mask, Positive

HALF = 0.5  # a response of a region that is rather road than not
SOLID = 0.75  # share of a road that looks like road: markings, cracks and shadows are the rest
MIDDLE_M = 6.0  # where lines are compared
MOST_PIECES = 400  # the hierarchy costs the square of them


def near_prediction(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    *,
    half_width_m: Positive = 0.4,
    growth: Annotated[float, Field(ge=0)] = 0.02,
) -> Features:
    """Only what lies within ``half_width_m`` + ``growth``·x of the boundaries of the last frame (A02).

    All of it while a side is unknown. Cannot see: a boundary that jumps.
    """
    if predicted is None or predicted.left is None or predicted.right is None:
        return features
    kept = near(view, [predicted.left, predicted.right], half_width_m=half_width_m, growth=growth)
    return _kept(features, kept)


def along_road(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    *,
    max_heading_rad: Annotated[float, Field(gt=0, lt=1.5)] = 0.4,
    min_length_m: Positive = 1.0,
) -> Features:
    """Connected pieces that run along the road: within ``max_heading_rad`` of ahead, ``min_length_m`` long (B06).

    The direction is that of the line y(x) through the piece on the road. A slope limit in the picture, as printed,
    would take the outer lines of a wide road away. Source: R [56]. Cannot see: sharp bends as one piece.
    """
    labels, pieces = _pieces(features, view)
    good = [
        number
        for number, ground in pieces
        if np.ptp(ground[:, 0]) >= min_length_m and abs(_heading_rad(ground)) <= max_heading_rad
    ]
    return _kept(features, np.isin(labels, good))


def as_wide_as_paint(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    *,
    widest_m: Positive = 0.4,
    least_px: Positive = 2.5,
) -> Features:
    """Runs of a row no wider than ``widest_m`` on the road: arrows, zebras, patches and glare go (B12 guard).

    Runs up to ``least_px`` are always kept: far paint is as thin as an edge. Cannot see: text written in thin
    strokes.
    """
    high = features.response > 0
    limit = np.maximum(width_px(view, widest_m), least_px)[:, None]
    return _kept(features, high & (_run_lengths(high) <= limit))


def middle_to_side(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    *,
    step_m: Positive = 0.35,
    from_m: Positive = 0.3,
) -> Features:
    """In every row, from near to far, the first response left and right of the middle that follows the row below.

    The scan starts in the middle of the predicted lane, or before the vehicle; a row links when its place on the
    road is within ``step_m`` of the row below, and starts anew after a gap of a dash. Source: R [72] (B12), whose
    scan fails when the first pair is an artefact: nothing within ``from_m`` of the middle begins a boundary.
    Cannot see: a second line on the same side; an arrow in the middle still stops a side that has no line yet.
    """
    high = features.response > 0
    kept = np.zeros_like(high)
    for sign in (1, -1):
        rows, columns = _linked(high, view, _middle(predicted), sign, step_m, from_m)
        kept[rows, columns] = True
    return _kept(features, kept)


def clusters(
    features: Features,
    view: View,
    predicted: Boundaries | None,
    *,
    join_m: Positive = 0.35,
    join_rad: Positive = 0.12,
    min_length_m: Positive = 3.0,
) -> Features:
    """Pieces joined to lines by their place and heading; lines of less than ``min_length_m`` go (B06).

    Agglomerative clustering, single linkage, of (place at 6 m / ``join_m``, heading / ``join_rad``), cut at 1; the
    length of a line is the sum of its pieces ahead. Source: R [56]. Cannot see: one short dash on its own.
    """
    labels, pieces = _pieces(features, view)
    pieces = [(number, ground) for number, ground in pieces if np.ptp(ground[:, 0]) > 0.1][:MOST_PIECES]
    if not pieces:
        return _kept(features, np.zeros(features.response.shape, bool))
    lines = [_line(ground) for _, ground in pieces]
    lengths = np.array([np.ptp(ground[:, 0]) for _, ground in pieces])
    spaced = np.array([[(a + b * MIDDLE_M) / join_m, math.atan(b) / join_rad] for a, b in lines])
    group = fcluster(linkage(spaced, "single"), 1.0, "distance") if len(pieces) > 1 else np.array([1])
    total = np.bincount(group, weights=lengths)
    good = [number for (number, _), own in zip(pieces, group, strict=True) if total[own] >= min_length_m]
    return _kept(features, np.isin(labels, good))


def patch_component(
    features: Features, view: View, predicted: Boundaries | None, *, close_m: Positive = 0.3
) -> Features:
    """The connected part of a region that the vehicle stands on; gaps of a row up to ``close_m`` are closed (B13).

    Source: R 1.2. Cannot see: a side road or a pavement that is connected with it.
    """
    road = features.response > HALF
    between = (
        np.logical_or.accumulate(road, axis=1) & np.logical_or.accumulate(road[:, ::-1], axis=1)[:, ::-1]
    )
    gap = between & ~road
    road |= gap & (_run_lengths(gap) <= width_px(view, close_m)[:, None])  # lines and cracks
    road = cv2.morphologyEx(road.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    labels = np.asarray(cv2.connectedComponents(road.astype(np.uint8), connectivity=4)[1])
    below = labels[patch(view) & road]
    if not len(below):
        return _kept(features, np.zeros(road.shape, bool))
    own = labels == np.bincount(below).argmax()
    whole = _filled(own)
    if np.mean(features.response[whole] > HALF) < SOLID:
        return _kept(features, np.zeros(road.shape, bool))  # noise: more hole than road
    return Features(whole.astype(np.float32), Kind.REGION)


def outline(features: Features, view: View, predicted: Boundaries | None) -> Features:
    """The left and the right border of a region in every row, as line features: from the middle outwards (B13).

    In each row the run of road that holds, or is next to, the middle of the run below. A border of the picture is
    no border of the road. Cannot see: the road beyond a vehicle that covers its full width.
    """
    road = features.response > HALF
    line = np.zeros(road.shape, np.uint8)
    middle = _middle(predicted)
    column = float("nan")
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
    if view.seen is not None:  # nor is the border of what the camera shows
        line[cv2.erode(view.seen.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0] = 0
    return Features(line, Kind.LINE)


def _kept(features: Features, where: Mask) -> Features:
    return replace(features, response=np.where(where, features.response, features.response.dtype.type(0)))


def _pieces(features: Features, view: View) -> tuple[NDArray[np.int32], list[tuple[int, Array]]]:
    """Connected pieces: their label image, and number and road points (x, y), shape (n, 2), of each."""
    count, labels = cv2.connectedComponents((features.response > 0).astype(np.uint8), connectivity=8)
    rows, columns = np.nonzero(labels)
    ground = view.ground(np.column_stack([columns, rows]))
    seen = np.isfinite(ground).all(axis=1)
    number = labels[rows, columns][seen]
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number, minlength=count))
    parts = np.split(ground[seen][order], ends[:-1])
    return np.asarray(labels, np.int32), [(i, part) for i, part in enumerate(parts) if len(part) > 1]


def _line(ground: Array) -> tuple[float, float]:
    """Least-squares y = a + b·x of road points."""
    x, y = ground.T
    spread = float(np.var(x))
    b = float(np.mean((x - x.mean()) * (y - y.mean())) / max(spread, 1e-6))
    return float(y.mean()) - b * float(x.mean()), b


def _heading_rad(ground: Array) -> float:
    return math.atan(_line(ground)[1])


def _runs(row: Mask) -> NDArray[np.int64]:
    """First and last column of each run of True, shape (n, 2)."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    return np.asarray(change.reshape(-1, 2) - [0, 1], np.int64)


def _run_lengths(high: Mask) -> NDArray[np.int64]:
    """For every pixel the length of the run of True in its row that it belongs to; 0 outside."""
    flat = np.pad(high, ((0, 0), (1, 1))).ravel()
    change = np.flatnonzero(np.diff(flat.astype(np.int8)))
    lengths = np.zeros(flat.size, np.int64)
    for first, last in change.reshape(-1, 2):
        lengths[first + 1 : last + 1] = last - first
    return lengths.reshape(high.shape[0], -1)[:, 1:-1]


def _middle(predicted: Boundaries | None) -> float:
    """y of the middle of the predicted lane before the vehicle; 0 when that is not known."""
    if predicted is None or predicted.left is None or predicted.right is None:
        return 0.0
    return float(predicted.left.y_m[0] + predicted.right.y_m[0]) / 2


def _linked(
    high: Mask, view: View, middle_m: float, sign: int, step_m: float, from_m: float
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


def _filled(region: Mask) -> Mask:
    """The region without holes: what cannot be reached from its outside."""
    contours, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    full = np.zeros(region.shape, np.uint8)
    cv2.drawContours(full, contours, -1, 1, cv2.FILLED)
    return full > 0
