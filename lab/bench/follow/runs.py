"""`trepid bench follow`: 1000 cases with the model of the detector, 40 with rendered images.

Every episode is in ``runs/follow_...jsonl`` when it ends; a run with the same seed continues from there.
"""

from collections.abc import Iterable
from functools import partial

import numpy as np

from lab.bench.follow.episode import drive, row
from sim_harness.sweep.store import Row, stored_rows
from trepid.config import WORK_DIR

RUNS, RENDERED_RUNS = 1000, 40
PATH_TARGET_M, STEP_TARGET_DEG, GAP_TARGET_S = 0.3, 2.0, 1.5


def bench_runs(seed: int) -> Row:
    """1 000 cases with the model of the camera's detector."""
    return summary(episodes(seed, RUNS, rendered=False))


def bench_rendered(seed: int) -> Row:
    """40 cases with rendered images and the detector."""
    return summary(episodes(seed, RENDERED_RUNS, rendered=True))


def episodes(seed: int, count: int, *, rendered: bool) -> list[Row]:
    """The episodes of ``count`` cases; stored ones are not driven again."""
    path = WORK_DIR / "runs" / f"follow_{'rendered' if rendered else 'modelled'}_{seed}.jsonl"
    wanted = {str(one): one for one in range(seed * 10_000, seed * 10_000 + count)}
    return stored_rows(path, partial(_drive, rendered=rendered), wanted)


def _drive(seed: int, *, rendered: bool) -> Row:
    return row(drive(seed, rendered=rendered))


def summary(done: list[Row]) -> Row:
    """The figures over all episodes, then by the action of the leader."""
    result: Row = {
        "targets": f"0 collisions, ≤ {PATH_TARGET_M} m from the path, ≤ {STEP_TARGET_DEG}° of wheel",
        **_figures(done),
    }
    for kind in sorted({episode["kind"] for episode in done}):
        result[kind] = _figures([episode for episode in done if episode["kind"] == kind])
    return result


def _figures(done: list[Row]) -> Row:
    followed = [episode for episode in done if episode["followed_s"] > 0]
    path_m, joined_m = _numbers(followed, "path_error_m"), _numbers(followed, "joined_error_m")
    gap_s = _numbers(followed, "min_time_gap_s")
    return {
        "runs": len(done),
        "followed": len(followed),
        "collisions": sum(episode["collisions"] for episode in done),
        "runs with departures": sum(episode["departures"] > 0 for episode in done),
        "path error m (p50, p99, max)": _spread(path_m),
        f"runs over {PATH_TARGET_M} m": int((path_m > PATH_TARGET_M).sum()),
        "path error once led over m (p50, p99, max)": _spread(joined_m),
        f"runs over {PATH_TARGET_M} m once led over": int((joined_m > PATH_TARGET_M).sum()),
        "hand-over step deg (p50, p99, max)": _spread(_numbers(done, "hand_over_step_deg")),
        "hand-over turn in 0.2 s deg (p50, p99, max)": _spread(_numbers(done, "hand_over_turn_deg")),
        "off lane centre m (p50, p99, max)": _spread(_numbers(done, "road_error_m")),
        "least time gap s (min, p1, p50)": _spread(gap_s, (0, 1, 50)),
        "stopped": sum(episode["stopped"] for episode in done),
    }


def _numbers(done: Iterable[Row], name: str) -> np.ndarray:
    return np.array([episode[name] for episode in done if episode[name] is not None], float)


def _spread(values: np.ndarray, percents: tuple[int, ...] = (50, 99, 100)) -> list[float] | None:
    return [round(float(v), 3) for v in np.percentile(values, percents)] if len(values) else None
