"""Agreement of estimates with the labels of the real sets, by the protocol of each MANIFEST."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.bench.perception.real.frames import Picture
from trepid.config import InputError
from trepid.messages import PixelPath, SteeringEstimate
from trepid.types import Array, Mask

Row = dict[str, float | None]
Pairs = Sequence[tuple[Picture, SteeringEstimate]]

TUSIMPLE_ROWS = np.arange(260, 701, 10)
WITHIN_PX = 20.0
LINE_RIGHT = 0.85  # share of its points, as the TuSimple benchmark has it
ROAD_CLASS, VOID_CLASS = 3, 11  # of CamVid's labels
MAGENTA = (255, 0, 255)  # KITTI: road or ego lane
US_LANE_M = 3.7


def tusimple(pairs: Pairs) -> Row:
    """Points of the two ego lines within 20 px of the label in the same row; lines by 85 % of their points."""
    right = labelled = answered = lines = false = missed = 0
    for picture, estimate in pairs:
        paths = estimate.left_boundary_px, estimate.right_boundary_px
        for truth, path in zip(ego_lines(picture), paths, strict=True):
            if truth is None:
                continue
            mine = columns(path, TUSIMPLE_ROWS.astype(float))
            seen = ~np.isnan(truth)
            good = int((np.abs(mine - truth)[seen & ~np.isnan(mine)] <= WITHIN_PX).sum())
            is_right = good >= LINE_RIGHT * seen.sum()
            right, labelled = right + good, labelled + int(seen.sum())
            answered += int((seen & ~np.isnan(mine)).sum())
            lines, missed = lines + 1, missed + (not is_right)
            false += bool(path) and not is_right
    return {
        "images": len(pairs),
        "accuracy_pct": 100 * right / max(labelled, 1),
        "correctness_pct": 100 * right / answered if answered else None,
        "false_lines_pct": 100 * false / max(lines, 1),
        "missed_lines_pct": 100 * missed / max(lines, 1),
    }


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


def road_overlap(pairs: Pairs) -> Row:
    """CamVid: IoU of the area between the boundaries with the road, and errors of its borders."""
    labels = [label_of(picture)[..., 0] for picture, _ in pairs]
    row = _overlap(pairs, [(label == ROAD_CLASS, label != VOID_CLASS) for label in labels])
    offs_px = [
        off_px
        for (_, estimate), label in zip(pairs, labels, strict=True)
        for off_px in _border_errors_px(estimate, label == ROAD_CLASS)
    ]
    return row | {"border_px_median": float(np.median(offs_px)) if offs_px else None}


def lane_overlap(pairs: Pairs) -> Row:
    """KITTI: IoU of the area between the boundaries with the labelled ego lane."""
    lanes = [(label_of(picture) == np.array(MAGENTA)).all(axis=2) for picture, _ in pairs]
    return _overlap(pairs, [(lane, np.ones_like(lane)) for lane in lanes])


def _overlap(pairs: Pairs, truths: Sequence[tuple[Mask, Mask]]) -> Row:
    """Mean IoU with truths, each with the mask of its known part."""
    found = [_iou(estimate, *truth) for (_, estimate), truth in zip(pairs, truths, strict=True)]
    answered = sum(given for _, given in found)
    return {
        "images": len(pairs),
        "given_pct": 100 * answered / max(len(pairs), 1),
        "iou": float(np.mean([iou for iou, _ in found])) if answered else None,
    }


def _iou(estimate: SteeringEstimate, truth: Mask, known: Mask) -> tuple[float, bool]:
    """Intersection over union where the label is known, and whether there is an estimate."""
    rows = np.arange(truth.shape[0], dtype=float)
    left, right = (columns(path, rows) for path in (estimate.left_boundary_px, estimate.right_boundary_px))
    at = np.arange(truth.shape[1])
    with np.errstate(invalid="ignore"):  # NaN: not between
        mine = (at >= np.floor(left)[:, None]) & (at <= right[:, None])
    union = ((mine | truth) & known).sum()
    return float((mine & truth & known).sum() / max(union, 1)), bool(mine.any())


def _border_errors_px(estimate: SteeringEstimate, road: Mask) -> list[float]:
    """Distances along the rows between boundaries and the first and last column of the road, inside the picture."""
    rows = np.flatnonzero(road.any(axis=1))
    first, last = road.argmax(axis=1)[rows], road.shape[1] - 1 - road[:, ::-1].argmax(axis=1)[rows]
    found = []
    for path, truth in ((estimate.left_boundary_px, first), (estimate.right_boundary_px, last)):
        mine = columns(path, rows.astype(float))
        inside = (truth > 0) & (truth < road.shape[1] - 1) & ~np.isnan(mine)
        found += np.abs(mine - truth)[inside].tolist()
    return found


def steering(pairs: Pairs) -> Row:
    """Wheel angles compared with those of the driver, and with always straight."""
    truth = np.degrees(_numbers([picture.steering_rad for picture, _ in pairs]))
    mine = np.degrees(_numbers([estimate.road_wheel_angle_rad for _, estimate in pairs]))
    seen = ~np.isnan(mine)
    moving = seen.sum() > 2 and mine[seen].std() > 0 and truth[seen].std() > 0
    return {
        "frames": len(pairs),
        "given_pct": 100 * float(seen.mean()),
        "mae_deg": float(np.abs(mine - truth)[seen].mean()) if seen.any() else None,
        "mae_of_straight_deg": float(np.abs(truth[seen]).mean()) if seen.any() else None,
        "correlation": float(np.corrcoef(mine[seen], truth[seen])[0, 1]) if moving else None,
    }


def lane_widths(pairs: Pairs) -> Row:
    """Highway without labels: the width of the lane (3.7 m in the US), and the spread of width and offset."""
    widths = _numbers([estimate.lane_width_m for _, estimate in pairs])
    jumps = np.abs(np.diff(_numbers([estimate.lateral_offset_m for _, estimate in pairs])))
    jumps, known = jumps[np.isfinite(jumps)], widths[np.isfinite(widths)]
    drives = {picture.drive for picture, _ in pairs}
    row: Row = {"frames": len(pairs), "given_pct": 100 * len(known) / max(len(pairs), 1)}
    if len(known):
        row["width_m_median"] = float(np.median(known))
        row["width_error_pct_median"] = 100 * float(np.median(np.abs(known / US_LANE_M - 1)))
        row["width_m_spread"] = float(np.subtract(*np.percentile(known, (75, 25))))
    if len(jumps) and len(drives) == 1:
        row["offset_jump_m_p95"] = float(np.percentile(jumps, 95))
    return row


def _numbers(values: Sequence[float | None]) -> Array:
    """NaN where there is none."""
    return np.array([np.nan if value is None else value for value in values], float)


def label_of(picture: Picture) -> NDArray[np.uint8]:
    """The label as an image, shape (height, width, 3). Raises InputError."""
    label = cv2.imread(str(picture.label), cv2.IMREAD_COLOR)
    if label is None:
        raise InputError(f"{picture.label}: no label image")
    return np.asarray(label, np.uint8)


def columns(path: PixelPath, rows: Array) -> Array:
    """Columns of a boundary at image rows, by linear interpolation; NaN outside the seen part."""
    if not path:
        return np.full(len(rows), np.nan)
    points = np.array(sorted(path, key=lambda point: point[1]), float)
    return np.interp(rows, points[:, 1], points[:, 0], left=np.nan, right=np.nan)
