"""Figures of one estimator on one sequence, from the rows of :mod:`lab.bench.real.look`.

As in the protocols of the sets: a lane is wrong where less than 80 % of its area is road (or ego lane), and an
answer is confident above 0.5. Shares refer to all frames; ``iou`` counts a frame without an answer as 0,
``iou_answered`` leaves it out. AUROC: the probability that a wrong answer has less confidence (or more fear) than a
right one. Those named ``ego_`` refer to frames judged by eye, where the lane of the car is right.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lab.bench.real import baselines, ego_lane
from lab.bench.real.judgement import Judgements, verdicts
from lab.bench.real.labels import SURFACES, Labels
from learning.lane.scores import auroc
from trepid.types import Array, Mask

Row = dict[str, Any]
Figures = dict[str, float | int | None]
CONFIDENT, VERY_CONFIDENT = 0.5, 0.8
INSIDE = 0.8
EMPTY: Figures = dict.fromkeys(
    [
        "frames",
        "answered",
        "confident",
        "wrong_and_confident",
        "wrong_of_very_confident",
        "iou",
        "baseline_iou",
        "iou_answered",
        "baseline_iou_answered",
        "inside_road",
        "border_error_px",
        "tusimple_accuracy",
        "tusimple_false_lines",
        "tusimple_missed_lines",
        "lane_width_m",
        "lane_width_iqr_m",
        "mae_deg",
        "mae_straight_deg",
        "mae_mean_deg",
        "mae_previous_200ms_deg",
        "mae_around_500ms_deg",
        "correlation",
        "correlation_previous_200ms",
        "correlation_around_500ms",
        "auroc_confidence",
        "auroc_fear",
        "judged",
        "ego_lane_right",
        "ego_lane_right_of_confident",
        "ego_wrong_and_confident",
        "ego_auroc_confidence",
        "ego_auroc_fear",
        "drawn_lanes",
        "drawn_right_and_confident",
        "ego_iou",
        "baseline_ego_iou",
    ]
)


def figures(
    rows: Sequence[Row],
    name: str,
    labels: Labels,
    *,
    trapezoid: Mask | None,
    judged: Judgements,
    other_lane: Array | None = None,
) -> Figures:
    """All figures; None where the set has no such label.

    ``trapezoid``: the baseline of the road; ``other_lane``: that of the lane of the car.
    """
    answers = [row["estimates"][name] for row in rows]
    answered = np.array([answer["answered"] for answer in answers])
    confidence = np.array([answer["confidence"] for answer in answers])
    sure = answered & (confidence > CONFIDENT)
    found = EMPTY | {"frames": len(rows), "answered": _mean(answered), "confident": _mean(sure)}
    if labels in SURFACES:
        found |= _overlap(rows, answers, answered, confidence, trapezoid)
        found["border_error_px"] = _median(_numbers(answers, "border_error_px"))
    if labels is Labels.LINES:
        found |= _lines(answers)
    if labels is Labels.ANGLE:
        found |= _angles(rows, answers)
    widths = _numbers(answers, "width_m")
    found["lane_width_m"] = _median(widths)
    if len(widths):
        found["lane_width_iqr_m"] = float(np.subtract(*np.percentile(widths, (75, 25))))
    return found | _judge_rows(rows, name, sure, judged) | ego_lane.figures(rows, name, judged, other_lane)


def wrong(rows: Sequence[Row], name: str) -> Mask:
    """Answers of labelled rows whose lane is wrong."""
    answers = [row["estimates"][name] for row in rows]
    return np.array([answer["answered"] and answer["inside"] < INSIDE for answer in answers], bool)


def _overlap(
    rows: Sequence[Row], answers: Sequence[Row], answered: Mask, confidence: Array, fixed: Mask | None
) -> Figures:
    iou, inside, fear = (
        np.array(values, float)
        for values in (
            [answer["iou"] for answer in answers],
            [answer["inside"] for answer in answers],
            [row["fear"] for row in rows],
        )
    )
    bad = answered & (inside < INSIDE)
    very = answered & (confidence > VERY_CONFIDENT)
    masks = [baselines.masks_of(rows, field) for field in ("label", "known")]
    base = None if fixed is None else baselines.overlap(fixed, masks[0], masks[1])
    mixed = bool(bad.any() and (answered & ~bad).any())
    return {
        "wrong_and_confident": _mean(bad & (confidence > CONFIDENT)),
        "wrong_of_very_confident": _mean(bad[very]),
        "iou": _mean(iou),
        "iou_answered": _mean(iou[answered]),
        "baseline_iou": None if base is None else _mean(base),
        "baseline_iou_answered": None if base is None else _mean(base[answered]),
        "inside_road": _mean(inside[answered]),
        "auroc_confidence": auroc(-confidence[answered], bad[answered]) if mixed else None,
        "auroc_fear": auroc(fear[answered], bad[answered]) if mixed else None,
    }


def _lines(answers: Sequence[Row]) -> Figures:
    """Share of the labelled points within 20 px; false and missed lines, as shares of the labelled lines."""
    points, right, lines, false, missed = (
        sum(answer[name] for answer in answers)
        for name in ("points", "right_points", "lines", "false_lines", "missed_lines")
    )
    return {
        "tusimple_accuracy": right / points if points else None,
        "tusimple_false_lines": false / lines if lines else None,
        "tusimple_missed_lines": missed / lines if lines else None,
    }


def _angles(rows: Sequence[Row], answers: Sequence[Row]) -> Figures:
    """Degrees of the road wheels, over the frames with an angle."""
    truth = np.degrees([row["steering_rad"] for row in rows])
    mine = np.degrees(np.array([answer["angle_rad"] for answer in answers], float))
    seen = np.isfinite(mine)
    found: Figures = {"mae_deg": _mean(np.abs(mine - truth)[seen])}
    trivial = baselines.angles(rows)
    for name, angle_rad in trivial.items():
        off = np.abs(np.degrees(angle_rad) - truth)[seen]
        found[f"mae_{name}_deg"] = _mean(off[np.isfinite(off)])
    found["correlation"] = _correlation(mine, truth)
    for name in ("previous_200ms", "around_500ms"):
        other = np.where(seen, np.degrees(trivial[name]), np.nan)
        found[f"correlation_{name}"] = _correlation(other, truth)
    return found


def _correlation(one: Array, other: Array) -> float | None:
    """Where both are known; None where one of them does not change."""
    both = np.isfinite(one) & np.isfinite(other)
    moving = both.sum() > 2 and one[both].std() > 0 and other[both].std() > 0
    return float(np.corrcoef(one[both], other[both])[0, 1]) if moving else None


def _judge_rows(rows: Sequence[Row], name: str, sure: Mask, judged: Judgements) -> Figures:
    found = verdicts(rows, name, judged)
    known = np.array([verdict is not None for verdict in found], bool)
    right = np.array([bool(verdict) for verdict in found], bool)
    drawn = np.array([row["file"] in ego_lane.lanes_of_files([row["file"]], judged) for row in rows], bool)
    confidence = np.array([row["estimates"][name]["confidence"] for row in rows], float)
    fear, wrong_ones = np.array([row["fear"] for row in rows], float), known & ~right
    mixed = bool(wrong_ones.any() and (known & right).any())
    return {
        "judged": int(known.sum()),
        "ego_lane_right": _mean(right[known]),
        "ego_lane_right_of_confident": _mean(right[known & sure]),
        "ego_wrong_and_confident": _mean((wrong_ones & sure)[known]),
        "ego_auroc_confidence": auroc(-confidence[known], wrong_ones[known]) if mixed else None,
        "ego_auroc_fear": auroc(fear[known], wrong_ones[known]) if mixed else None,
        "drawn_right_and_confident": _mean((right & sure)[drawn]),
    }


def _numbers(answers: Sequence[Row], field: str) -> Array:
    """The values of ``field`` where there are any."""
    values = np.array([answer.get(field) for answer in answers], float)
    return np.asarray(values[np.isfinite(values)])


def _median(values: Array) -> float | None:
    return float(np.median(values)) if len(values) else None


def _mean(values: Array | Mask) -> float | None:
    return float(np.mean(values)) if len(values) else None
