"""Judgement of real frames by eye: is the drawn lane the lane of the car?

``judged.csv`` holds one row per frame and estimator: set, file, estimator, judgement (``right``, ``wrong``,
``cannot_say``), and the place of the lane that was judged, with which an answer of a later version can be compared:
columns of the left and of the right boundary in widths of the image at the rows of LANE_ROWS. A row with the
judgement ``lane`` and no estimator holds the lane of the car itself, drawn by eye. The first that holds of

- within SAME of a lane that was judged right (of any estimator): right,
- within SAME of a lane that was judged wrong: wrong,
- in a frame with the lane of the car: right where both boundaries lie within BESIDE of its own, else wrong,
- within SAME of a lane on which the judge could not say: not rated,
- in a frame where another lane was judged right: wrong,

rates an answer; others are not rated.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.bench.real.look import LANE_ROWS
from trepid.config import InputError
from trepid.types import Array

FILE = Path(__file__).parent / "judged.csv"
RIGHT, WRONG, CANNOT_SAY, LANE = "right", "wrong", "cannot_say", "lane"
PLACES = [f"{side}_{round(100 * row)}" for side in ("left", "right") for row in LANE_ROWS]
COLUMNS = ["set", "file", "estimator", "judgement", *PLACES]
SAME = 0.04  # of the image width, at every row where both lanes have both boundaries
BESIDE = 0.25  # of the width of the lane in the same row: a cycle lane or half a pavement more is wrong


@dataclass(frozen=True)
class Judged:
    """A lane and the verdict on it."""

    judgement: str
    lane: Array  # (2, rows); NaN where it has no boundary


Judgements = Mapping[str, Sequence[Judged]]
"""File -> what was judged in it, of one set."""


def judgements(path: Path = FILE) -> dict[str, dict[str, list[Judged]]]:
    """Set -> file -> judged lanes. Raises InputError with the line of the first bad row."""
    found: dict[str, dict[str, list[Judged]]] = {}
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
            one = Judged(row["judgement"], lane)
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


def _verdict(answer: Mapping[str, Any], judged: Sequence[Judged]) -> bool | None:
    lane = np.array(answer["lane"], float)
    near = {one.judgement for one in judged if same(lane, one.lane)}
    for verdict in (RIGHT, WRONG):
        if verdict in near:
            return verdict == RIGHT
    for one in judged:
        if one.judgement == LANE:
            return beside(lane, one.lane)
    other = any(one.judgement == RIGHT for one in judged)
    return False if other and CANNOT_SAY not in near else None


def beside(lane: Array, true: Array) -> bool | None:
    """Whether both boundaries lie within BESIDE of those of the ``true`` lane; None where no row has all four."""
    off = np.abs(lane - true) / (true[1] - true[0])
    both = np.isfinite(off).all(axis=0)
    return bool((off[:, both] <= BESIDE).all()) if both.any() else None


def same(a: Array, b: Array) -> bool:
    """Whether two lanes lie within SAME of each other where both are known; False where they share no row."""
    both = np.isfinite(a).all(axis=0) & np.isfinite(b).all(axis=0)
    return bool(both.any()) and bool((np.abs(a - b)[:, both] <= SAME).all())
