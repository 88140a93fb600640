"""Judgement of real frames by eye: is the drawn lane the lane of the car?

``judged.csv`` holds one row per frame and estimator: set, file, estimator, judgement (``right``, ``wrong``,
``cannot_say``), and the place of the lane that was judged, with which an answer of a later version can be compared:
columns of the left and of the right boundary in widths of the image at the rows of LANE_ROWS. A row with the
judgement ``lane`` and no estimator holds the lane of the car itself, drawn by eye. Distances of boundaries are
shares of the width of the judged lane in the same row, because a lane may be wider than the image. The first that
holds of

- within SAME of a lane that was judged right (of any estimator): right,
- within SAME of a lane that was judged wrong: wrong,
- in a frame with the lane of the car: right within BESIDE of it, else wrong,
- within SAME of a lane on which the judge could not say: not rated,
- in a frame where others were judged right: wrong, if it lies beyond BESIDE of all of them,

rates an answer; others are not rated. Where two drawings of the lane of the car differ by more than a fifth of its
width, a third look decided. Rows in which it is narrower than 0.15 of the image are empty: it lies some 20 m ahead
there or farther, where the eye does not place a boundary to a quarter of the width.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.bench.real.look import LANE_ROWS
from trepid.config import InputError
from trepid.types import Array

FILE = Path(__file__).parent / "judged.csv"
RIGHT, WRONG, CANNOT_SAY, LANE = "right", "wrong", "cannot_say", "lane"
PLACES = [f"{side}_{round(100 * row)}" for side in ("left", "right") for row in LANE_ROWS]
COLUMNS = ["set", "file", "estimator", "judgement", *PLACES]
SAME = 0.1  # of the width of the lane, at every row where both lanes have both boundaries
BESIDE = 0.25  # a cycle lane or half a pavement more is wrong


@dataclass(frozen=True)
class JudgedLane:
    """A lane and the verdict on it."""

    judgement: str
    lane: Array  # (2, rows); NaN where it has no boundary


Judgements = Mapping[str, Sequence[JudgedLane]]
"""File -> what was judged in it, of one set."""


def judgements(path: Path = FILE) -> dict[str, dict[str, list[JudgedLane]]]:
    """Set -> file -> judged lanes. Raises InputError with the line of the first bad row."""
    found: dict[str, dict[str, list[JudgedLane]]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames != COLUMNS:
            raise InputError(f"{path}:1:1: expected the columns {', '.join(COLUMNS)}")
        for line, row in enumerate(reader, start=2):
            if row["judgement"] not in (RIGHT, WRONG, CANNOT_SAY, LANE):
                raise InputError(
                    f"{path}:{line}:1: expected right, wrong, cannot_say or lane, got {row['judgement']!r}"
                )
            try:
                lane = np.array([float(row[name] or "nan") for name in PLACES]).reshape(2, -1)
            except (TypeError, ValueError) as error:
                raise InputError(f"{path}:{line}:1: expected numbers in {', '.join(PLACES)}") from error
            one = JudgedLane(row["judgement"], lane)
            found.setdefault(row["set"], {}).setdefault(row["file"], []).append(one)
    return found


def verdicts(rows: Sequence[dict[str, Any]], name: str, judged: Judgements) -> list[bool | None]:
    """Whether each answer of ``name`` is the lane of the car; None where nothing says it, or without an answer."""
    return [
        _verdict(row["estimates"][name], judged.get(row["file"], ()))
        if row["estimates"][name]["answered"]
        else None
        for row in rows
    ]


def _verdict(answer: Mapping[str, Any], judged: Sequence[JudgedLane]) -> bool | None:
    lane = np.array(answer["lane"], float)
    near = {one.judgement for one in judged if within(lane, one.lane, SAME)}
    for verdict in (RIGHT, WRONG):
        if verdict in near:
            return verdict == RIGHT
    for one in judged:
        if one.judgement == LANE:
            return within(lane, one.lane, BESIDE)
    if CANNOT_SAY in near:
        return None
    beyond = [within(lane, one.lane, BESIDE) is False for one in judged if one.judgement == RIGHT]
    return False if beyond and all(beyond) else None


def within(lane: Array, judged: Array, share: float) -> bool | None:
    """Whether both boundaries lie within ``share`` of the width of the ``judged`` lane from its own, in every row.

    None where no row has all four boundaries.
    """
    off = np.abs(lane - judged) / (judged[1] - judged[0])
    both = np.isfinite(off).all(axis=0)
    return bool((off[:, both] <= share).all()) if both.any() else None
