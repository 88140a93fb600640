"""Scores of a lead detector: detections matched with true vehicles, and the calibration of its confidence.

A *false leader* is a detection in the own lane of a frame without any vehicle: the car would brake for nothing.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from perception.lead.detection import Platt
from perception.lead.view import DISTANCES_M

SAME_RATIO, SAME_ASIDE_M, SAME_ASIDE_PER_M = 1.25, 0.8, 0.02
"""Bounds of a right detection: ratio of distances, and lateral error."""
MIN_VISIBLE = 0.6
BESIDE_M = 7.5  # the strips end half a metre farther out
BANDS_M = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 90.0, 115.0)
IN_LANE_M = (
    1.35  # a vehicle whose side is nearer to the lane centre reaches 0.3 m into a lane of 3.3 m (UN R157)
)
Found = tuple[float, float, float, float]
"""Ahead of and left of the camera, width [m], probability."""


class Match(NamedTuple):
    """A true vehicle or a detection, and its counterpart, if any."""

    true: NDArray[np.float32] | None  # its label: ahead, left, width [m], visible share
    found: Found | None
    asked: bool  # False: hardly visible or out of range, not scored


class FrameMatches(NamedTuple):
    """The matches of one frame."""

    matches: list[Match]
    lane_left_m: NDArray[np.float32]  # (STRIPS,): centre of the own lane
    weather: tuple[str, ...]

    @property
    def is_empty(self) -> bool:
        """No vehicle is anywhere in the frame, not even a hidden one."""
        return all(match.true is None for match in self.matches)

    def has_leader(self, min_probability: float) -> bool:
        """A detection of at least ``min_probability`` lies in the own lane."""
        found = [match.found for match in self.matches if match.found is not None and match.asked]
        return any(
            probability >= min_probability
            and abs(left_m - np.interp(ahead_m, DISTANCES_M, self.lane_left_m)) < IN_LANE_M + width_m / 2
            for ahead_m, left_m, width_m, probability in found
        )


def match(truth: NDArray[np.float32], found: Sequence[Found], *, reach_m: float) -> list[Match]:
    """Pairs of true vehicles (m, LABEL) and detections in falling order of confidence; the rest is unpaired."""
    free = [row for row in truth if np.isfinite(row[0]) and row[0] > 0]
    pairs = []
    for answer in sorted(found, key=lambda f: -f[3]):
        close = [(abs(math.log(answer[0] / row[0])), i) for i, row in enumerate(free) if _same(row, answer)]
        if close:
            row = free.pop(min(close)[1])
            pairs.append(Match(row, answer, _is_asked(row, reach_m)))
        else:
            pairs.append(Match(None, answer, asked=answer[0] <= reach_m))
    return pairs + [Match(row, None, _is_asked(row, reach_m)) for row in free]


def _same(row: NDArray[np.float32], answer: Found) -> bool:
    aside_m = SAME_ASIDE_M + SAME_ASIDE_PER_M * float(row[0])
    return abs(math.log(answer[0] / row[0])) < math.log(SAME_RATIO) and abs(answer[1] - row[1]) < aside_m


def _is_asked(row: NDArray[np.float32], reach_m: float) -> bool:
    return bool(row[3] >= MIN_VISIBLE and row[0] <= reach_m and abs(row[1]) <= BESIDE_M)


def calibrate(matches: Iterable[Match]) -> Platt:
    """Maximum-likelihood bias and slope of Platt scaling."""
    asked = [m for m in matches if m.found is not None and m.asked]
    p = np.clip([m.found[3] for m in asked if m.found], 1e-6, 1 - 1e-6)
    right = np.array([m.true is not None for m in asked])
    logit = np.log(p / (1 - p))

    def cost(x: NDArray[np.float64]) -> float:
        z = x[0] + x[1] * logit
        return float(np.mean(np.logaddexp(0, np.where(right, -z, z))))

    bias, slope = minimize(cost, (0.0, 1.0), method="Nelder-Mead").x.tolist()
    return Platt(bias=round(bias, 4), slope=round(slope, 4))


def by_distance(matches: Sequence[Match], *, min_probability: float) -> dict[str, dict[str, float]]:
    """``scores`` of each band of BANDS_M; a match belongs to the band of its vehicle, a false one to its own."""
    bands = {}
    for low_m, high_m in pairwise(BANDS_M):
        some = [one for one in matches if low_m <= _ahead_m(one) < high_m]
        bands[f"{low_m:g} to {high_m:g} m"] = scores(some, min_probability=min_probability)
    return bands


def _ahead_m(one: Match) -> float:
    place = one.found if one.true is None else one.true
    return math.nan if place is None else float(place[0])


def by_weather(frames: Sequence[FrameMatches], *, min_probability: float) -> dict[str, dict[str, float]]:
    """Recall and false leaders in each weather; a frame in rain and fog counts for both."""
    rows = {}
    for weather in sorted({name for frame in frames for name in frame.weather}):
        some = [frame for frame in frames if weather in frame.weather]
        figures = scores([one for frame in some for one in frame.matches], min_probability=min_probability)
        rows[weather] = {
            "frames": float(len(some)),
            **{name: figures[name] for name in ("vehicles", "recall", "precision")},
            "false_leaders_per_1000_frames": false_leaders(some, min_probability=min_probability),
        }
    return rows


def false_leaders(frames: Sequence[FrameMatches], *, min_probability: float) -> float:
    """Frames with a false leader per 1000 frames without a vehicle; NaN without such frames."""
    empty = [frame for frame in frames if frame.is_empty]
    return 1e3 * float(np.mean([frame.has_leader(min_probability) for frame in empty])) if empty else math.nan


def scores(matches: Sequence[Match], *, min_probability: float) -> dict[str, float]:
    """Recall, precision and errors of the detections of at least ``min_probability``."""
    sure = [m for m in matches if m.found is None or m.found[3] >= min_probability or m.true is not None]
    hit = [m for m in sure if m.true is not None and m.found is not None and m.found[3] >= min_probability]
    asked_hits = [m for m in hit if m.asked]
    there = sum(m.true is not None and m.asked for m in sure)
    false = sum(m.true is None and m.asked for m in sure)
    result = {
        "vehicles": float(there),
        "recall": len(asked_hits) / max(there, 1),
        "precision": len(hit) / max(len(hit) + false, 1),
    }
    if not asked_hits:
        return result
    true = np.array([m.true[:3] for m in asked_hits if m.true is not None], np.float64)
    found = np.array([m.found[:3] for m in asked_hits if m.found is not None], np.float64)
    ratio, aside_m = np.log(found[:, 0] / true[:, 0]), found[:, 1] - true[:, 1]
    return result | {
        "distance_error_percent": 100 * float(np.median(np.abs(ratio))),
        "distance_error_p95_percent": 100 * float(np.percentile(np.abs(ratio), 95)),
        "distance_bias_percent": 100 * float(np.mean(ratio)),
        "lateral_error_m": float(np.median(np.abs(aside_m))),
        "lateral_error_p95_m": float(np.percentile(np.abs(aside_m), 95)),
    }
