"""The papers' printed steering rules beside each other: by their angle, and alone in closed loop (S01-S16).

The rules of five papers turn two straight lines of a picture into an angle. All of them get the lines of the same
chain (``rule_*`` of ``config/pipelines.yaml``), so that they differ in the rule alone. Beside them stand PEERS: the
same chain with the exact pair of lines and pure pursuit, and the estimator ``cv``. All roads have lines, which the
rules need.

*By angle*: clips of :mod:`lab.bench.perception.clips`. The truth is the road-wheel angle of an arc to the lane
centre ahead. ``within 2 deg`` is the share of all frames; a frame without an answer is not within.

*In closed loop*: courses of :mod:`lab.bench.perception.drive`, where the angle is the command. The rank of a course
is that of the interventions, then of the root mean square offset. ``rank correlation`` is Spearman's, between the
share within 2 deg and the mean rank: 1 where a better angle is a better drive.

Intervals are those of a bootstrap over clips and over drives. One line a clip and one a drive in
``out/bench_perception``: an interrupted study continues.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import rankdata, spearmanr

from drive.tally import autonomy_percent
from lab.bench.perception.bench import FOLDER, watch_clips
from lab.bench.perception.clips import GAP, ClipCase, harness_set
from lab.bench.perception.drive import COURSES, DURATION_S, drive_rows
from lab.bench.perception.scores import TOLERANCE_RAD, Results, score_clips
from lab.bench.study.passages import mean_and_interval
from perception.techniques.recipe import recipes
from sim_harness.sweep.store import Row
from sim_harness.world.roads.drawn import UNMARKED
from trepid.messages import EstimateKind

PEERS = ("canny_auto_hough", "cv")
MARKED_COURSES = tuple(number for number, (kind, *_) in enumerate(COURSES) if kind not in UNMARKED)
SEEDS, QUICK_SEEDS, QUICK_COURSES = 5, 1, 3
BETTER_M = 1e3  # of the offset, that one intervention outweighs


def compared_rules() -> tuple[str, ...]:
    """Every pipeline that gives an angle and no lane, and PEERS."""
    return (*(name for name, recipe in recipes().items() if recipe.kind is EstimateKind.ANGLE), *PEERS)


def marked_clips(seed: int) -> list[ClipCase]:
    """The clips of a seed on roads with lines: every kind in clear weather, and every disturbance."""
    cases = harness_set(seed, quick=True)
    return [case for case in cases if case.kind not in UNMARKED and case.condition != GAP]


def bench_rules(seed: int, *, jobs: int = 1, count: int | None = None, quick: bool = False) -> Row:
    """Both tables over ``count`` seeds from ``seed`` on; ``quick``: one seed, and QUICK_COURSES courses of each."""
    names, seeds = compared_rules(), count or (QUICK_SEEDS if quick else SEEDS)
    courses = MARKED_COURSES[:QUICK_COURSES] if quick else MARKED_COURSES
    clips: dict[ClipCase, Any] = {}
    drives: dict[str, list[Row]] = {name: [] for name in names}
    for one in range(seed, seed + seeds):
        clips |= watch_clips(marked_clips(one), names, one, jobs=jobs)
        for name, rows in drive_rows(names, one, FOLDER, courses=courses, jobs=jobs).items():
            drives[name] += rows
    return tables(clips, drives)


def tables(clips: Results, drives: Mapping[str, Sequence[Row]]) -> Row:
    """The tables of the page, the best rank in closed loop first."""
    angles = {name: angle_row(clips, name) for name in drives}
    loop = rank_drives(drives)
    order = [angles[name]["within 2 deg [%]"] for name in loop], [row["mean rank"] for row in loop.values()]
    correlation = float(spearmanr(order[0], np.negative(order[1])).statistic)
    return {
        "in closed loop, alone": loop,
        "by angle": {name: angles[name] for name in loop},
        "rank correlation": None if np.isnan(correlation) else round(correlation, 2),
        "clips": len(clips),
        "drives of each": len(next(iter(drives.values()))),
    }


def angle_row(clips: Results, name: str) -> Row:
    """Answered frames, those within 2 deg of all, and the error of the answered ones."""
    errors = [np.degrees(score_clips(clips, name, [case])["angle_rad"].astype(float)) for case in clips]
    within = [100.0 * float(np.mean(np.abs(one) <= np.degrees(TOLERANCE_RAD))) for one in errors]
    mean, low, high = mean_and_interval(within)
    every = np.concatenate(errors)
    said = every[np.isfinite(every)]
    return {
        "within 2 deg [%]": round(mean, 1),
        "from": round(low, 1),
        "to": round(high, 1),
        "answered [%]": round(100.0 * len(said) / len(every), 1),
        "median error [deg]": round(float(np.median(np.abs(said))), 2) if len(said) else None,
        "bias [deg]": round(float(np.mean(said)), 2) if len(said) else None,
    }


def rank_drives(drives: Mapping[str, Sequence[Row]]) -> dict[str, Row]:
    """One row a rule, the best mean rank over the courses first."""
    names = list(drives)
    badness = np.array(
        [[BETTER_M * row["interventions"] + np.sqrt(row["square_m2"]) for row in drives[n]] for n in names]
    )
    ranks = rankdata(badness, axis=0)  # rule × drive
    table: dict[str, Row] = {}
    for name, own in zip(names, ranks, strict=True):
        rank, low, high = mean_and_interval(own.tolist())
        rows = drives[name]
        autonomy = [autonomy_percent(row["interventions"], DURATION_S) for row in rows]
        table[name] = {
            "mean rank": round(rank, 2),
            "from": round(low, 2),
            "to": round(high, 2),
            "autonomy [%]": round(float(np.mean(autonomy)), 1),
            "interventions": sum(row["interventions"] for row in rows),
            "courses without": sum(row["interventions"] == 0 for row in rows),
            "offset rms [m]": round(float(np.sqrt(np.mean([row["square_m2"] for row in rows]))), 3),
            "without answer [%]": round(100.0 * float(np.mean([row["blind"] for row in rows])), 1),
        }
    return dict(sorted(table.items(), key=lambda one: one[1]["mean rank"]))
