"""Labels of the real sets, by the protocol of each MANIFEST, and the agreement of boundaries with them."""

from collections.abc import Callable
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.bench.real.frames import Picture
from trepid.config import InputError
from trepid.messages import PixelPath, SteeringEstimate
from trepid.types import Array, Mask

TUSIMPLE_ROWS = np.arange(260, 701, 10)
WITHIN_PX = 20.0
LINE_RIGHT = 0.85  # share of its points, as the TuSimple benchmark has it
ROAD_CLASS, VOID_CLASS = 3, 11  # of CamVid's labels
MAGENTA = (255, 0, 255)  # KITTI: road or ego lane

Truth = tuple[Mask, Mask]
"""Pixels of the labelled road or lane, and those where the label is known; both (height, width)."""


class Labels(StrEnum):
    """What the labels of a sequence show."""

    ROAD = "road"  # the whole carriageway
    LANE = "lane"  # the ego lane
    LINES = "lines"  # the lines of the ego lane
    ANGLE = "angle"  # the driver's wheel angle
    NONE = "none"


def road(picture: Picture) -> Truth:
    """The carriageway of CamVid, known outside the void class."""
    label = label_of(picture)[..., 0]
    return label == ROAD_CLASS, label != VOID_CLASS


def ego_lane(picture: Picture) -> Truth:
    """The ego lane of KITTI."""
    lane = (label_of(picture) == np.array(MAGENTA)).all(axis=2)
    return lane, np.ones_like(lane)


def between_ego_lines(picture: Picture) -> Truth:
    """The surface between the two ego lines of TuSimple; known in the rows where both are labelled."""
    height, width = label_of(picture).shape[:2]
    lane, known = np.zeros((height, width), bool), np.zeros((height, width), bool)
    left, right = ego_lines(picture)
    if left is None or right is None:
        return lane, known
    seen = np.isfinite(left) & np.isfinite(right)
    rows = np.arange(TUSIMPLE_ROWS[seen][0], TUSIMPLE_ROWS[seen][-1] + 1)
    edges = [np.interp(rows, TUSIMPLE_ROWS[seen], side[seen]) for side in (left, right)]
    at = np.arange(width)
    lane[rows] = (at >= edges[0][:, None]) & (at <= edges[1][:, None])
    known[rows] = True
    return lane, known


SURFACES: dict[Labels, Callable[[Picture], Truth]] = {
    Labels.ROAD: road,
    Labels.LANE: ego_lane,
    Labels.LINES: between_ego_lines,
}
"""The labels that show a surface."""


def ego_lines(picture: Picture) -> tuple[Array | None, Array | None]:
    """Columns of the labelled lines nearest to the middle of the picture, left and right, at TUSIMPLE_ROWS."""
    label = label_of(picture)[..., 0]
    lines = []
    for value in np.unique(label)[1:]:
        places = [np.flatnonzero(label[row] == value) for row in TUSIMPLE_ROWS]
        columns = np.array([place.mean() if len(place) else np.nan for place in places])
        seen = np.flatnonzero(~np.isnan(columns))
        if len(seen) > 3:
            foot = np.polyval(np.polyfit(TUSIMPLE_ROWS[seen[-8:]], columns[seen[-8:]], 1), 700.0)
            lines.append((float(foot), columns))
    middle = label.shape[1] / 2
    left = max((line for line in lines if line[0] < middle), key=lambda line: line[0], default=None)
    right = min((line for line in lines if line[0] >= middle), key=lambda line: line[0], default=None)
    return (left[1] if left else None), (right[1] if right else None)


def line_counts(picture: Picture, found: SteeringEstimate) -> dict[str, int]:
    """TuSimple: labelled points of the ego lines and those within 20 px in the same row; labelled lines, false and
    missed ones. A line is right with 85 % of its points.
    """
    counts = dict.fromkeys(("points", "right_points", "lines", "false_lines", "missed_lines"), 0)
    paths = found.left_boundary_px, found.right_boundary_px
    for truth, path in zip(ego_lines(picture), paths, strict=True):
        if truth is None:
            continue
        off_px = np.abs(columns(path, TUSIMPLE_ROWS.astype(float)) - truth)  # NaN: not within
        points, good = int(np.isfinite(truth).sum()), int((off_px <= WITHIN_PX).sum())
        missed = good < LINE_RIGHT * points
        new = (points, good, 1, bool(path) and missed, missed)
        counts = {name: counts[name] + int(more) for name, more in zip(counts, new, strict=True)}
    return counts


def border_error_px(found: SteeringEstimate, surface: Mask) -> float | None:
    """Median distance along the rows between boundaries and the ends of the labelled road inside the picture."""
    rows = np.flatnonzero(surface.any(axis=1))
    last = surface.shape[1] - 1
    ends = surface.argmax(axis=1)[rows], last - surface[:, ::-1].argmax(axis=1)[rows]
    paths = found.left_boundary_px, found.right_boundary_px
    off_px = np.concatenate(
        [
            np.abs(columns(path, rows.astype(float)) - end)[(end > 0) & (end < last)]
            for path, end in zip(paths, ends, strict=True)
        ]
    )
    seen = off_px[np.isfinite(off_px)]
    return float(np.median(seen)) if len(seen) else None


def label_of(picture: Picture) -> NDArray[np.uint8]:
    """The label as an image of the size of the picture, shape (height, width, 3). Raises InputError."""
    label = cv2.imread(str(picture.label), cv2.IMREAD_COLOR)
    if label is None:
        raise InputError(f"{picture.label}: no label image")
    size = picture.image.shape[1::-1]
    return np.asarray(cv2.resize(label, size, interpolation=cv2.INTER_NEAREST), np.uint8)


def columns(path: PixelPath, rows: Array) -> Array:
    """Columns of a boundary at image rows, by linear interpolation; NaN outside the seen part."""
    if not path:
        return np.full(len(rows), np.nan)
    points = np.array(sorted(path, key=lambda point: point[1]), float)
    return np.interp(rows, points[:, 1], points[:, 0], left=np.nan, right=np.nan)
