"""Division into train, validation and test: by time with a gap, or by route.

Frames next to each other look alike, so a division at random would test what was trained. By time every route is
cut into three pieces in the order train, validation, test, with ``gap_s`` left out at each border. By route whole
routes are the test, others the validation. A border never lies inside a frozen piece, and rows of train and
validation that look like a row of a later split are left out.
"""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import NONE, SPLITS, Split
from learning.dataset.likeness import STILL, ImageMeasurements, near_duplicates
from trepid.config import InputError
from trepid.types import Column, Floats, Mask

PAUSE_PERIODS = 5.0  # a step in time of more usual periods is a pause ...
ROUNDING_S = 1e-6
LEAST_PAUSE_S = 0.5  # ... if it is this long
LEAST_SPREAD_RAD = math.radians(0.1)
"""Standard deviation of recorded road-wheel angles below which a split shows no steering.

A steering wheel of the ratio 16 then moves by 1.6°, as in a hand that holds it still.
"""
GAP, ALIKE_WHY = "gap between splits", "near duplicate of a frame of a later split"


def without_steering(angles_rad: Column | Floats) -> bool:
    """Whether recorded angles (n,) vary so little that any constant fits them; false without angles."""
    return len(angles_rad) > 0 and float(np.std(angles_rad)) < LEAST_SPREAD_RAD


def stretches(t_s: Column, route: NDArray[np.str_]) -> NDArray[np.int32]:
    """Number of the piece without pauses that each row belongs to; time that runs back is a pause too."""
    if not len(t_s):
        return np.empty(0, np.int32)
    step_s = np.diff(t_s)
    same = route[1:] == route[:-1]
    usual_s = float(np.median(step_s[same & (step_s > 0)])) if (same & (step_s > 0)).any() else 0.0
    pause = ~same | ~(step_s >= 0) | (step_s > max(LEAST_PAUSE_S, PAUSE_PERIODS * usual_s))
    return np.concatenate([[0], np.cumsum(pause)]).astype(np.int32)


def too_short(split: Split, t_s: Column, route: NDArray[np.str_], why: NDArray[np.str_]) -> str:
    """In words, that the gaps of a division by time cover a whole split in every route; empty where they do not.

    Only the times of the usable rows, in order, count here: a camera that hangs and time that runs back are no lack
    of length.
    """
    usable, shares = why == "", [share for share in split.shares.values() if share > 0]
    if split.by != "time" or not usable.any():
        return ""
    times_s = [np.sort(t_s[usable & (route == name)]) for name in np.unique(route[usable])]
    left: set[str] = set()
    for at_s in times_s:
        rows = np.arange(len(at_s))
        names = _cut(rows, np.ones(len(rows), bool), split.shares, np.full(len(rows), math.inf))
        reasons = np.full(len(rows), "", dtype="<U64")
        clear_gaps(names, reasons, at_s, np.full(len(rows), ""), split.gap_s)
        left |= set(names[reasons == ""].tolist())
    if all(name in left for name, share in split.shares.items() if share > 0):
        return ""
    lasts_s = max(float(np.ptp(at_s)) for at_s in times_s)
    covered = [split.gap_s * (0.5 if place in (0, len(shares) - 1) else 1.0) for place in range(len(shares))]
    needed_s = max(gap_s / share for gap_s, share in zip(covered, shares, strict=True))
    need = f", which need {needed_s:.3g} s" if lasts_s < needed_s else ""
    gaps = f"gaps of {split.gap_s:g} s between splits (--gap-s)"
    return f"a drive of {lasts_s:.2g} s is too short for {gaps}{need}"


def split_rows(
    split: Split, t_s: Column, route: NDArray[np.str_], why: NDArray[np.str_], look: ImageMeasurements
) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    """The columns ``split`` and ``why``; rows with a reason already are ``none``. Raises InputError."""
    if abs(sum(split.shares.values()) - 1.0) > 1e-6 or set(split.shares) != set(SPLITS):
        raise InputError(f"--shares: expected three shares with the sum 1, got {split.shares}")
    usable = why == ""
    names = np.full(len(t_s), SPLITS[0], dtype="<U10")
    if split.by == "time":
        for name in np.unique(route):
            mine = np.flatnonzero(route == name)
            names[mine] = _cut(mine, usable, split.shares, look.change)
    else:
        names = _by_route(split, route, usable, look)
    reasons = why.astype("<U64")
    clear_gaps(names, reasons, t_s, route, split.gap_s)
    clear_duplicates(names, reasons, look)
    names[reasons != ""] = NONE
    return names, reasons


def _cut(rows: NDArray[np.intp], usable: Mask, shares: dict, change: Column | Floats) -> NDArray[np.str_]:
    """The split of the rows of one route, in order, by shares of its usable rows; none begins in a frozen piece."""
    done = np.cumsum(usable[rows]) / max(1, usable[rows].sum())
    names = np.full(len(rows), SPLITS[0], dtype="<U10")
    until = 0.0
    for before, name in pairwise(SPLITS):
        until += shares[before]
        border = int(np.searchsorted(done, until, side="right"))
        while 0 < border < len(rows) and change[rows[border]] <= STILL:
            border += 1
        if shares[name] > 0:
            names[border:] = name
    return names


def _by_route(
    split: Split, route: NDArray[np.str_], usable: Mask, look: ImageMeasurements
) -> NDArray[np.str_]:
    """Whole routes for the test (named, or drawn until the share is reached), then for the validation.

    With a single route left beside the test, the validation is cut off its end.
    """
    if split.shares["test"] == 1.0:
        return np.full(len(route), SPLITS[2], dtype="<U10")
    if not (split.shares["test"] or split.test_routes):
        raise InputError("--shares: a split by route needs a share of the test above 0, or --test-route")
    routes = sorted(set(route.tolist()))
    strange = [name for name in split.test_routes if name not in routes]
    if strange:
        raise InputError(f"--test-route {strange[0]}: no such route; there are {', '.join(routes)}")
    drawn = np.random.default_rng(split.seed).permutation(routes).tolist()
    test = list(split.test_routes) or _take_routes(drawn, split.shares["test"], route, usable)
    left = [name for name in drawn if name not in test]
    if not left or not test:
        raise InputError(
            f"a split by route needs two routes at least, got {', '.join(routes)}; split by time"
        )
    names = np.where(np.isin(route, test), SPLITS[2], SPLITS[0]).astype("<U10")
    if len(left) > 1:
        names[np.isin(route, _take_routes(left, split.shares["validation"], route, usable))] = SPLITS[1]
    else:
        rest = split.shares["train"] + split.shares["validation"]
        shares = {name: split.shares[name] / rest for name in ("train", "validation")}
        mine = np.flatnonzero(route == left[0])
        names[mine] = _cut(mine, usable, {**shares, "test": 0.0}, look.change)
    return names


def _take_routes(routes: list[str], share: float, route: NDArray[np.str_], usable: Mask) -> list[str]:
    """The first routes that hold ``share`` of the usable rows, and never all routes."""
    taken: list[str] = []
    for name in routes[:-1]:
        if np.isin(route[usable], taken).mean() >= share:
            break
        taken.append(name)
    return taken


def clear_gaps(
    names: NDArray[np.str_], reasons: NDArray[np.str_], t_s: Column, route: NDArray[np.str_], gap_s: float
) -> None:
    """Leave out the rows nearer than half a gap to a border between two splits of one route.

    Where time runs back, also those nearer than the gap to a row of a later split.
    """
    borders = np.flatnonzero((names[1:] != names[:-1]) & (route[1:] == route[:-1])) + 1
    for border in borders:
        same = route == route[border]
        near = same & (t_s > t_s[border] - gap_s / 2) & (t_s < t_s[border] + gap_s / 2) & (reasons == "")
        reasons[near] = GAP
    for name in np.unique(route):
        for number, earlier in enumerate(SPLITS[:-1]):
            mine = np.flatnonzero((route == name) & (names == earlier) & (reasons == ""))
            later = (route == name) & np.isin(names, SPLITS[number + 1 :]) & (reasons == "")
            reasons[mine[_nearest_s(t_s[mine], t_s[later]) < gap_s - ROUNDING_S]] = GAP


def _nearest_s(t_s: Column, others_s: Column) -> Column:
    """Time from each of ``t_s`` to the nearest of ``others_s``; infinite without any."""
    bounded = np.concatenate([[-np.inf], np.sort(others_s), [np.inf]])
    after = np.searchsorted(bounded, t_s)
    return np.minimum(bounded[after] - t_s, t_s - bounded[after - 1])


def clear_duplicates(names: NDArray[np.str_], reasons: NDArray[np.str_], look: ImageMeasurements) -> None:
    """Leave out rows that look like a row of a later split."""
    for number, name in enumerate(SPLITS[:-1]):
        rows = np.flatnonzero((names == name) & (reasons == ""))
        later = np.flatnonzero(np.isin(names, SPLITS[number + 1 :]) & (reasons == ""))
        if len(rows) and len(later):
            reasons[rows[near_duplicates(look, rows, later)]] = ALIKE_WHY
