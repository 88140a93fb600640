"""Overlap of answers with the lane of the car where it was drawn by eye, beside one lane drawn in other sequences.

The label of a street is its whole carriageway, of which the lane of the car is about a half; a lane that was drawn
is what an answer should be. Lanes are compared in the rows LANE_ROWS, inside the image.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from lab.bench.real.judgement import LANE, Judgements
from trepid.types import Array


def lanes_of_files(files: Iterable[str], judged: Judgements) -> dict[str, Array]:
    """File -> lane of the car in it, shape (2, rows)."""
    return {file: one.lane for file in files for one in judged.get(file, ()) if one.judgement == LANE}


def fixed_lane(files: Iterable[str], judged: Judgements) -> Array | None:
    """The median of the lanes drawn in ``files``, row by row; None without any."""
    lanes = list(lanes_of_files(files, judged).values())
    return np.asarray(np.median(lanes, axis=0)) if lanes else None


def overlap(lane: Array, true: Array) -> float:
    """Intersection over union of two lanes inside the image, in the rows of ``true``; 0 without ``lane``."""
    lane, true = (np.clip(one[:, np.isfinite(true).all(axis=0)], 0, 1) for one in (lane, true))
    ends = np.where(np.isfinite(lane).all(axis=0), lane, 0.0)
    shared = np.maximum(np.minimum(ends[1], true[1]) - np.maximum(ends[0], true[0]), 0.0).sum()
    union = (ends[1] - ends[0]).sum() + (true[1] - true[0]).sum() - shared
    return float(shared / union) if union > 0 else 0.0


def figures(
    rows: Sequence[dict[str, Any]], name: str, judged: Judgements, other: Array | None
) -> dict[str, float | int | None]:
    """Number of frames with a drawn lane, mean overlap of the answers, and that of the lane ``other``."""
    lanes = lanes_of_files((row["file"] for row in rows), judged)
    found = {row["file"]: np.array(row["estimates"][name]["lane"], float) for row in rows}
    mine = [overlap(found[file], true) for file, true in lanes.items()]
    base = [overlap(other, true) for true in lanes.values()] if other is not None else []
    return {
        "drawn_lanes": len(lanes) or None,
        "ego_iou": float(np.mean(mine)) if mine else None,
        "baseline_ego_iou": float(np.mean(base)) if base else None,
    }
