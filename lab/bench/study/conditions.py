"""Where a lane is kept: autonomy by light, weather, road and speed, of vision, a network, and both under fear.

The review asks which conditions a test of a lane keeper has to hold, and how vision and learned networks compare in
them. Every combination of LIGHTS, WEATHERS, ROADS and SPEEDS_MPS is driven with each seed by DRIVERS: ``cv`` and
``cnn`` alone, at full speed and without fear (:mod:`lab.bench.fear.supervision`), and the supervised car, which has
both. All drive the same pictures of the same seed.

Autonomy is that of NVIDIA's paper (Bojarski et al., 2016): six seconds an intervention. A supervised car may also
stop, which is no intervention: ``driven`` is the share of the route that it drove.

The command of a failed drive is ``trepid sim run`` with the settings and the seed of its conditions: it repeats the
supervised drive bit by bit. One line a drive in ``runs/conditions_<seed>.jsonl``; an interrupted study continues.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from statistics import fmean
from typing import Any, NamedTuple

from lab.bench.fear.drives import SupervisionCase
from lab.bench.fear.kinds import DRIVEN, kind_of, kinds
from lab.bench.fear.supervision import Driver, drive
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.store import stored_rows
from trepid.config import WORK_DIR

Row = dict[str, Any]
LIGHTS = {"day": "", "night": "night", "low sun": "low_sun"}
WEATHERS = {"clear": "", "rain": "rain", "fog": "fog", "snow": "snow"}
ROADS = {"lines": "s_curve", "no lines": "unmarked_bend"}
"""Name -> the scenario whose road is driven: bends of R = 25 m and R = 30 m."""
SPEEDS_MPS = (5, 9)
GRADE = 3
ROUTE_M, DURATION_S = 120, 40
SEEDS = 3
DRIVERS = {"cv alone": Driver.CV, "cnn alone": Driver.CNN, "both under fear": None}


class Conditions(NamedTuple):
    """One combination."""

    light: str
    weather: str
    road: str
    speed_mps: int

    @property
    def settings(self) -> dict[str, str]:
        """The fields of the scenario that differ from its file, as of ``--set``."""
        kinds = [kind for kind in (LIGHTS[self.light], WEATHERS[self.weather]) if kind]
        disturbances = ", ".join(f"{{kind: {kind}, grade: {GRADE}}}" for kind in kinds)
        return {
            "disturbances": f"[{disturbances}]",
            "start.speed_mps": f"{self.speed_mps}",
            "speed_mps": f"{self.speed_mps}",
            "distance_m": f"{ROUTE_M}",
            "duration_s": f"{DURATION_S}",
        }

    def scenario(self) -> Scenario:
        """What is driven."""
        return load_scenario(ROADS[self.road], self.settings)

    def command(self, seed: int) -> str:
        """The command that repeats the supervised drive."""
        settings = " ".join(f"--set '{name}={value}'" for name, value in self.settings.items())
        return f"trepid sim run {ROADS[self.road]} --seed {seed} {settings}"

    def __str__(self) -> str:
        return f"{self.light}, {self.weather}, {self.road}, {self.speed_mps} m/s"


class StudiedDrive(NamedTuple):
    """A drive of one driver."""

    conditions: Conditions
    driver: str
    seed: int


def all_conditions() -> Iterator[Conditions]:
    """Every combination."""
    return (Conditions(*one) for one in product(LIGHTS, WEATHERS, ROADS, SPEEDS_MPS))


def bench_conditions(seed: int, *, jobs: int = 1, quick: bool = False) -> Row:
    """Autonomy and driven share by condition, kinds of failure, commands of failed drives; ``quick``: one seed."""
    seeds = 1 if quick else SEEDS
    drives = [
        StudiedDrive(conditions, driver, seed + number)
        for conditions in all_conditions()
        for driver in DRIVERS
        for number in range(seeds)
    ]
    path = WORK_DIR / "runs" / f"conditions_{seed}.jsonl"
    rows = stored_rows(path, drive_row, {" ".join(map(str, one)): one for one in drives}, jobs=jobs)
    return tables(dict(zip(drives, rows, strict=True))) | {"seeds of each": seeds, "drives": len(drives)}


def drive_row(task: StudiedDrive) -> Row:
    """The scores of a drive."""
    case = SupervisionCase(task.conditions.scenario(), task.seed, clean=False)
    result = drive(case, DRIVERS[task.driver])
    row = result.row()
    names = ("autonomy_percent", "departures", "interventions", "max_lateral_error_m", "mean_speed_mps")
    return {name: row[name] for name in names} | {
        "driven_percent": min(100.0, 100.0 * row["distance_m"] / ROUTE_M),
        "cause": max(row["causes"], key=row["causes"].__getitem__, default=""),
    }


def tables(found: Mapping[StudiedDrive, Row]) -> Row:
    """The tables of the page."""
    by: dict[str, Callable[[Conditions], str]] = {
        "light and weather": lambda one: f"{one.light}, {one.weather}",
        "road and speed": lambda one: f"{one.road}, {one.speed_mps} m/s",
    }
    page: Row = {}
    for name, part_of in by.items():
        for title, field in (("autonomy [%]", "autonomy_percent"), ("driven [%]", "driven_percent")):
            page[f"{title} by {name}"] = mean_table(found, part_of, field)
    page["kinds of failure, drives"] = {
        driver: kinds([row for one, row in found.items() if one.driver == driver]) for driver in DRIVERS
    }
    page["failed drives under fear"] = {
        f"{one.conditions}, seed {one.seed}": {
            "what": kind_of(row),
            "cause": row["cause"],
            "command": f"`{one.conditions.command(one.seed)}`",
        }
        for one, row in found.items()
        if DRIVERS[one.driver] is None and kind_of(row) != DRIVEN
    }
    return page


def mean_table(found: Mapping[StudiedDrive, Row], part_of: Callable[[Conditions], str], field: str) -> Row:
    """Part of the conditions -> driver -> the mean of a field; None where no drive has it.

    A car that never moved has no autonomy.
    """
    parts = dict.fromkeys(part_of(one.conditions) for one in found)
    return {
        part: {
            driver: mean_of(
                row[field]
                for one, row in found.items()
                if one.driver == driver and part_of(one.conditions) == part
            )
            for driver in DRIVERS
        }
        for part in parts
    }


def mean_of(values: Iterable[float | None]) -> float | None:
    """The mean of those that are known; None without any."""
    known = [one for one in values if one is not None]
    return round(fmean(known), 1) if known else None
