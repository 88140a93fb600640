"""Laps on the floor tiles of Duckietown: photographed and drawn ones, through the interfaces of plug-ins.

The car is what `trepid init --like duckiebot` writes.
The world is :mod:`.tile_world`, by its entry point, as another package would add it. The estimator is `tape`, the
supervisor drives. A wheel over the middle of a line of the right half of the road is a departure.

Every drive is one line in ``runs/tiles_<seed>.jsonl``; stored drives are not repeated, so that an interrupted
benchmark continues.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cockpit.car.init import Like, write_car
from lab.bench.foreign.tile_files import tile_files
from lab.bench.foreign.tile_track import read_track
from lab.bench.perception.tracks import since_start
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import Scenario
from sim_harness.scenarios.world_choice import WorldChoice
from sim_harness.sweep.store import Row, stored_rows
from trepid.config import WORK_DIR, using_car

MAPS = ("small_loop", "loop_empty", "zigzag_dists")  # to the left alone; one bend to the right; five
LOOKS = ("photos", "synthetic")
LAPS = 10
SLOWEST_MPS = 0.15  # below which a drive ends without its laps
STANDING_S = 10.0  # before the supervisor first lets the car drive, at most
ESTIMATORS = ("tape",)


class TileLaps(NamedTuple):
    """One drive."""

    map: str
    look: str
    laps: int
    seed: int
    estimators: tuple[str, ...]

    @property
    def key(self) -> str:
        """Its name in the store."""
        return f"{self.map} {self.look} {self.laps} {self.seed} {'+'.join(self.estimators)}"


def bench_tiles(
    seed: int, quick: bool = False, estimators: Sequence[str] = (), jobs: int | None = None
) -> dict[str, Any]:
    """Departures, engaged share, speed and lateral error by map and tiles.

    ``quick``: one lap of each instead of ten. Raises InputError where the tiles cannot be had.
    """
    tile_files()
    names = tuple(estimators) or ESTIMATORS
    drives = [TileLaps(name, look, 1 if quick else LAPS, seed, names) for name in MAPS for look in LOOKS]
    path = WORK_DIR / "runs" / f"tiles_{seed}.jsonl"
    rows = stored_rows(path, driven_row, {drive.key: drive for drive in drives}, jobs=jobs)
    return {
        "laps": sum(row["laps"] for row in rows),
        "departures": sum(row["departures"] for row in rows),
        "drives": {f"{row['map']}, {row['look']}": _figures(row) for row in rows},
    }


def _figures(row: Row) -> Row:
    return {name: value for name, value in row.items() if name not in ("map", "look", "key")}


def driven_row(drive: TileLaps) -> Row:
    """The stored row of a drive."""
    files = tile_files()
    lap_m = read_track(files / "maps" / f"{drive.map}.yaml", Path(drive.look)).length_m
    with tempfile.TemporaryDirectory() as name:
        write_car(Path(name) / "car", Like.DUCKIEBOT)
        with using_car(Path(name) / "car"):
            result = run(scenario_of(drive, drive.laps * lap_m), seed=drive.seed)
    engaged_percent, speed_mps = since_start(result.trace)
    metrics = result.metrics
    return {
        "map": drive.map,
        "look": drive.look,
        "laps": int(metrics.distance_m / lap_m + 1e-2),
        "departures": metrics.departures,
        "engaged_percent": round(engaged_percent, 1),
        "mean_speed_mps": round(speed_mps, 3),
        "largest_offset_m": metrics.max_lateral_error_m,
        "rms_offset_m": metrics.rms_lateral_error_m,
    }


def scenario_of(drive: TileLaps, way_m: float) -> Scenario:
    """The scenario of a drive over ``way_m``."""
    return Scenario(
        name=f"{drive.map}_{drive.look}",
        description=f"{drive.laps} laps of {drive.map} on tiles, {drive.look}",
        tags=("curve",),
        world=WorldChoice(model="tiles", options={"map": drive.map, "look": drive.look}),
        duration_s=way_m / SLOWEST_MPS + STANDING_S,
        distance_m=way_m,
        estimators=drive.estimators,
    )
