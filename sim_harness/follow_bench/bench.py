"""`trepid bench follow`: a thousand cases with the model of the detector, some with the detector itself.

Every episode is written to ``out/bench_follow`` when it ends; the same seed goes on where an earlier call stopped.
"""

import json
import os
import sys
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.follow_bench.detector import bench_lead
from sim_harness.follow_bench.episode import drive, row
from sim_harness.sweep.crew import crew

RUNS, RENDERED_RUNS = 1000, 40
FOLDER = Path("out/bench_follow")
PATH_TARGET_M, STEP_TARGET_DEG, GAP_TARGET_S = 0.3, 2.0, 1.5


def bench_runs(seed: int) -> dict[str, Any]:
    """1 000 cases with the model of the camera's detector."""
    return summary(episodes(seed, RUNS, rendered=False))


def bench_rendered(seed: int) -> dict[str, Any]:
    """40 cases with pictures and the detector itself."""
    return summary(episodes(seed, RENDERED_RUNS, rendered=True))


def bench_follow(seed: int) -> dict[str, Any]:
    """The detector, the cases with it, and the cases with its model."""
    parts = {"detector": bench_lead, "rendered": bench_rendered, "modelled": bench_runs}
    return {f"{part} {key}": value for part, call in parts.items() for key, value in call(seed).items()}


def episodes(seed: int, count: int, *, rendered: bool) -> list[dict[str, Any]]:
    """The episodes of ``count`` cases; those that are on file are not driven again."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / f"{'rendered' if rendered else 'modelled'}-{seed}.jsonl"
    done = _read(path)
    wanted = [seed * 10_000 + number for number in range(count)]
    left = [one for one in wanted if one not in done]
    started_s = time.monotonic()
    with crew(os.cpu_count() or 1) as workers, path.open("a", encoding="utf-8") as file:
        for number, episode in enumerate(workers.map(partial(_driven, rendered=rendered), left), start=1):
            done[episode["seed"]] = episode
            file.write(json.dumps(episode) + "\n")
            file.flush()
            if number % 20 == 0 or number == len(left):
                left_s = (time.monotonic() - started_s) * (len(left) - number) / number
                _say(f"{path.stem}: {len(done)}/{count} episodes, {left_s / 60:.1f} min left")
    return [done[one] for one in wanted]


def _driven(seed: int, *, rendered: bool) -> dict[str, Any]:
    return row(drive(seed, rendered=rendered))


def _read(path: Path) -> dict[int, dict[str, Any]]:
    """Episodes by seed; a last line that was cut off is none."""
    found: dict[int, dict[str, Any]] = {}
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.is_file() else []
    for line in lines:
        if line.endswith("\n"):
            episode = json.loads(line)
            found[episode["seed"]] = episode
    return found


def summary(done: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures over all episodes, then by what the leader did."""
    result: dict[str, Any] = {
        "targets": f"0 collisions, ≤ {PATH_TARGET_M} m from the path, ≤ {STEP_TARGET_DEG}° of wheel",
        **_figures(done),
    }
    for kind in sorted({episode["kind"] for episode in done}):
        result[kind] = _figures([episode for episode in done if episode["kind"] == kind])
    return result


def _figures(done: list[dict[str, Any]]) -> dict[str, Any]:
    followed = [episode for episode in done if episode["followed_s"] > 0]
    path_m = _numbers(followed, "path_error_m")
    gap_s = _numbers(followed, "min_time_gap_s")
    return {
        "runs": len(done),
        "followed": len(followed),
        "collisions": sum(episode["collisions"] for episode in done),
        "runs with departures": sum(episode["departures"] > 0 for episode in done),
        "path error m (p50, p99, max)": _spread(path_m),
        f"runs over {PATH_TARGET_M} m": int((path_m > PATH_TARGET_M).sum()),
        "hand-over step deg (p50, p99, max)": _spread(_numbers(done, "hand_over_step_deg")),
        "hand-over turn in 0.2 s deg (p50, p99, max)": _spread(_numbers(done, "hand_over_turn_deg")),
        "off lane centre m (p50, p99, max)": _spread(_numbers(done, "road_error_m")),
        "least time gap s (min, p1, p50)": _spread(gap_s, (0, 1, 50)),
        "stopped": sum(episode["stopped"] for episode in done),
    }


def _numbers(done: Iterable[dict[str, Any]], name: str) -> np.ndarray:
    return np.array([episode[name] for episode in done if episode[name] is not None], float)


def _spread(values: np.ndarray, percents: tuple[int, ...] = (50, 99, 100)) -> list[float] | None:
    return [round(float(v), 3) for v in np.percentile(values, percents)] if len(values) else None


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


FOLLOW_SECTIONS = {"runs": bench_runs, "rendered": bench_rendered, "detector": bench_lead}
