"""Laps on small taped tracks with pixels: ovals with bends of 1.5, 2 and 3 lane widths, on ten tapes and floors,
and along a single line.

The car is ``config/cars/mini`` on lanes of 0.22 m; for the single line with ``lines: middle`` in
``tape.yaml``. A lap begins at standstill. The time until the supervisor first lets the car drive does not count: it
waits for healthy inputs at every start.

Every lap is one line in ``runs/tracks_<seed>.jsonl``; stored laps are not repeated, so that an interrupted
benchmark continues.
"""

import shutil
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np

from perception.tape.settings import Lines
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.store import Row, stored_rows
from sim_harness.world.tracks import LOOKS, taped_track
from supervisor.modes.modes import DRIVING
from trepid.config import CONFIG_DIR, WORK_DIR, using_car

CAR, LANE_M = "mini", 0.22
BENDS = (1.5, -1.5, 2.0, -2.0, 3.0, -3.0)  # radius in lane widths, + = to the left
ESTIMATORS = ("tape",)
SEEDS = 3
LONGEST_S = 60.0
TARGETS = "targets: departures 0; engaged 95 %; speed 0.3 m/s"


class Lap(NamedTuple):
    """One drive."""

    bend: float
    look: str
    seed: int
    estimators: tuple[str, ...]

    @property
    def key(self) -> str:
        """Its name in the store."""
        return f"{self.bend:g} {self.look} {self.seed} {'+'.join(self.estimators)}"


def bench_tracks(
    seed: int, quick: bool = False, estimators: Sequence[str] = (), jobs: int | None = None
) -> dict[str, Any]:
    """Departures, engaged share, speed and lateral error by bend and by tape and floor.

    ``quick``: the tightest bends with one seed. Laps that another command has stored are not driven again.
    """
    names = tuple(estimators) or ESTIMATORS
    laps = [
        Lap(bend, look, seed + number, names)
        for number in range(1 if quick else SEEDS)
        for bend in (BENDS[:2] if quick else BENDS)
        for look in LOOKS
    ]
    path = WORK_DIR / "runs" / f"tracks_{seed}.jsonl"
    rows = stored_rows(path, driven_row, {lap.key: lap for lap in laps}, jobs=jobs)
    return summary(rows)


def scenario_of(lap: Lap, folder: Path) -> Scenario:
    """The scenario of a lap; its road is written into ``folder``."""
    road = folder / f"{lap.look}_{lap.bend:g}.yaml"
    track = taped_track(road.stem, LOOKS[lap.look], lane_width_m=LANE_M, bend=lap.bend)
    road.write_text(track.model_dump_json(exclude_defaults=True), encoding="utf-8")  # JSON is YAML
    return Scenario(
        name=road.stem,
        description=f"a lap with bends of R = {lap.bend:g} lane widths, {lap.look}",
        tags=("curve",),
        road=str(road),
        duration_s=LONGEST_S,
        estimators=lap.estimators,
    )


def car_of(lap: Lap, folder: Path) -> Path:
    """The folder of the car of a lap: the shipped one, or a copy in ``folder`` that follows a single line."""
    car = CONFIG_DIR / "cars" / CAR
    if LOOKS[lap.look].right is not None:
        return car
    car = Path(shutil.copytree(car, folder / CAR))
    (car / "tape.yaml").write_text(f"lane: {{lines: {Lines.MIDDLE}}}\n", encoding="utf-8")
    return car


def driven_row(lap: Lap) -> Row:
    """The stored row of a lap."""
    with tempfile.TemporaryDirectory() as folder, using_car(car_of(lap, Path(folder))):
        result = run(scenario_of(lap, Path(folder)), seed=lap.seed)
    metrics, trace = result.metrics, result.trace
    engaged_percent, speed_mps = since_start(trace)
    return {
        "bend": lap.bend,
        "look": lap.look,
        "finished": bool(trace["finished"][-1]),
        "departures": metrics.departures,
        "engaged_percent": engaged_percent,
        "speed_mps": speed_mps,
        "largest_offset_m": metrics.max_lateral_error_m,
        "mean_fear": metrics.mean_fear,
    }


def since_start(trace: Trace) -> tuple[float, float]:
    """Share of the time in a mode that drives [%], and mean speed [m/s], since the first such moment; 0 without."""
    drives = np.isin(
        trace["mode"], [code for code, word in enumerate(trace.words["mode"]) if word in DRIVING]
    )
    if not drives.any():
        return 0.0, 0.0
    first = int(np.argmax(drives))
    held_s = np.diff(trace["t_s"][first:])
    way_m = float(trace["station_m"][-1] - trace["station_m"][first])
    total_s = float(held_s.sum())
    if total_s <= 0.0:
        return 0.0, 0.0
    return 100.0 * float(held_s[drives[first:-1]].sum()) / total_s, way_m / total_s


def summary(rows: list[Row]) -> dict[str, Any]:
    """The tables of the laps, and one line for all."""
    bends = {_bend_name(bend): [row for row in rows if row["bend"] == bend] for bend in BENDS}
    looks = {look: [row for row in rows if row["look"] == look] for look in LOOKS}
    return {
        "all laps": _scores(rows),
        "by tape and floor": {name: _scores(some) for name, some in looks.items() if some},
        "by bend": {name: _scores(some) for name, some in bends.items() if some},
        "targets": TARGETS,
    }


def _scores(rows: Iterable[Row]) -> Row:
    some = list(rows)
    return {
        "laps": len(some),
        "finished": sum(row["finished"] for row in some),
        "departures": sum(row["departures"] for row in some),
        "engaged_percent": round(fmean(row["engaged_percent"] for row in some), 1),
        "mean_speed_mps": round(fmean(row["speed_mps"] for row in some), 3),
        "least_speed_mps": round(min(row["speed_mps"] for row in some), 3),
        "largest_offset_m": round(max(row["largest_offset_m"] for row in some), 4),
    }


def _bend_name(bend: float) -> str:
    return f"R = {abs(bend):g} lane widths, {'left' if bend > 0 else 'right'}"
