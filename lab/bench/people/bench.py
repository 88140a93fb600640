"""`trepid bench people`: step-outs, bystanders and cyclists in lock-step, and the detector on real pictures.

The sensor of the road users is modelled, exact in fewer drives, or the published detector on rendered frames. What
is not on this machine is named in a line. A drive ends when the car is past the road user.

Every drive is one line in ``runs/people_<seed>.jsonl``: an interrupted benchmark continues.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lab.bench.people.cases import BYSTANDER, CYCLIST, STEP_OUT, Encounter, build_scenario, cases
from lab.bench.people.real import real_pictures
from lab.bench.real.sets import data_folder
from perception.lead.finder import lead_finder, lead_settings
from sim_harness.lockstep.closed_loop import Instant, build_parts, run
from sim_harness.sweep.store import stored_rows
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, InputError, load
from trepid.messages import Stop

COUNT, QUICK, RENDERED, QUICK_RENDERED = 100, 10, 8, 1
EXACT_SHARE = 0.1  # of the drives with a modelled sensor, which is the harder one
DETECTOR = Path("objectron")
STOOD_MPS = 0.1
PAST_M = 1.0
TRUTH, MODELLED, DETECTED = "exact", "modelled", "detector, rendered frames"
SIGHT = {TRUTH: "truth", MODELLED: "truth", DETECTED: "camera"}
SENSOR = {TRUTH: "truth", MODELLED: "modelled", DETECTED: "camera"}
GAPS_M = ((1.7, 2.5), (2.5, 3.5), (3.5, 4.5), (4.5, 6.0))  # of bystanders, from the lane centre


@dataclass(slots=True)
class RunView:
    """What a run shows, sample by sample."""

    nose_m: float  # front bumper before the rear axle
    car_m: float  # length of the car
    stood: bool = False  # before the road user, not at the start
    emergency: bool = False
    passing_mps: float = math.nan  # speed where the bumper is beside the road user
    last_mps: float = 0.0
    _ahead_m: float = field(default=math.inf)

    def has_passed(self, _: Instant) -> bool:
        """Whether the whole car is past the road user."""
        return self._ahead_m < -self.car_m - PAST_M

    def add(self, now: Instant) -> None:
        """Take one instant."""
        truth, speed_mps = now.truth, now.state.speed_mps or 0.0
        self.last_mps = speed_mps
        if truth.elapsed_s is None or truth.elapsed_s < 0 or not truth.user_x_m:
            return
        cos, sin = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
        ahead_m = cos * (truth.user_x_m[0] - truth.x_m) + sin * (truth.user_y_m[0] - truth.y_m) - self.nose_m
        self.stood = self.stood or (ahead_m > 0 and speed_mps < STOOD_MPS)
        self.emergency = self.emergency or (now.decision is not None and now.decision.stop is Stop.EMERGENCY)
        if self._ahead_m > 0 >= ahead_m:
            self.passing_mps = speed_mps
        self._ahead_m = ahead_m


def bench_people(
    seed: int,
    *,
    jobs: int = 1,
    quick: bool = False,
    count: int | None = None,
    data: Path | None = None,
) -> dict[str, Any]:
    """Stops, collisions and decelerations by sensor; the speed beside bystanders; recall on real pictures."""
    number = count or (QUICK if quick else COUNT)
    few = QUICK_RENDERED if quick else RENDERED
    counts = {TRUTH: max(round(number * EXACT_SHARE), 1), MODELLED: number, DETECTED: few}
    found: dict[str, dict[str, Any]] = {kind: {} for kind in (STEP_OUT, BYSTANDER, CYCLIST)}
    beside: dict[str, Any] = {}
    for sensor, total in counts.items():
        missing = _missing() if sensor == DETECTED else ""
        for kind, rows in found.items():
            if missing:
                rows[sensor] = missing
                continue
            drawn = cases(kind, seed, total if kind == STEP_OUT else max(total // 3, 1))
            driven = _drive_cases(drawn, sensor, WORK_DIR / "runs" / f"people_{seed}.jsonl", jobs=jobs)
            rows[sensor] = SCORES[kind](driven)
            if kind == BYSTANDER:
                beside |= {f"{sensor}, {name}": row for name, row in by_distance(driven).items()}
    return {
        "step-outs": found[STEP_OUT],
        "bystanders": found[BYSTANDER],
        "speed beside bystanders by their distance from the lane centre": beside,
        "cyclists ahead": found[CYCLIST],
        "real pictures": real_pictures(data_folder(data), DETECTOR, quick=quick),
    }


Row = dict[str, Any]


def _drive_cases(
    drawn: list[Encounter], sensor: str, path: Path, *, jobs: int
) -> list[tuple[Encounter, Row]]:
    """Every case with the result of its run, which ``path`` holds."""
    named = {f"{sensor}, {case.kind} {number}": case for number, case in enumerate(drawn)}
    rows = stored_rows(path, partial(drive, sensor=sensor), named, jobs=jobs)
    return list(zip(drawn, rows, strict=True))


def drive(case: Encounter, *, sensor: str) -> Row:
    """The scores of one run."""
    scenario = build_scenario(case, sight=SIGHT[sensor], lead_sensor="truth", road_user_sensor=SENSOR[sensor])
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    parts = build_parts(scenario, seed=0)
    if sensor == DETECTED:
        camera = load(CONFIG_DIR / "camera.yaml", Camera)
        parts = replace(parts, lead=lead_finder(lead_settings(DETECTOR), camera, vehicle))
    nose_m = vehicle.wheelbase_m + vehicle.front_overhang_m
    seen = RunView(nose_m, nose_m + vehicle.rear_overhang_m)
    result = run(scenario, seed=0, parts=parts, witness=seen.add, until=seen.has_passed)
    return {
        "collisions": result.metrics.collisions,
        "decel_mps2": result.metrics.max_decel_mps2,
        "distance_m": result.metrics.distance_m,
        "stood": seen.stood,
        "emergency": seen.emergency,
        "passing_mps": seen.passing_mps,
        "went_on": seen.last_mps > STOOD_MPS,
    }


def _missing() -> str:
    """Why the published detector cannot run here, in one line; "" where it can."""
    try:
        camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        lead_finder(lead_settings(DETECTOR), camera, vehicle)
    except InputError as error:
        return f"not measured: {error}"
    return ""


def _common(driven: list[tuple[Encounter, Row]]) -> Row:
    rows = [row for _, row in driven]
    decels = [row["decel_mps2"] for row in rows if row["decel_mps2"] is not None]
    return {
        "runs": len(rows),
        "collisions": sum(row["collisions"] for row in rows),
        "emergency brakes": sum(row["emergency"] for row in rows),
        "max. deceleration [m/s²]": round(max(decels), 2) if decels else None,
    }


def step_outs(driven: list[tuple[Encounter, Row]]) -> Row:
    """Stopped are the runs without a collision in which the car stood before the road user."""
    stopped = [row["stood"] and not row["collisions"] for _, row in driven]
    return _common(driven) | {
        "stopped": sum(stopped),
        "of those hidden by a van": sum(
            ok for (case, _), ok in zip(driven, stopped, strict=True) if case.hidden
        ),
        "hidden by a van": sum(case.hidden for case, _ in driven),
        "went on": sum(row["went_on"] for _, row in driven),
    }


def bystanders(driven: list[tuple[Encounter, Row]]) -> Row:
    """A drive past a person beside the lane passes without a stop."""
    return _common(driven) | {"stops not needed": sum(row["stood"] for _, row in driven)}


def cyclists(driven: list[tuple[Encounter, Row]]) -> Row:
    """A cyclist without room beside is followed."""
    overtaken = sum(math.isfinite(row["passing_mps"]) for _, row in driven)
    return _common(driven) | {"overtaken": overtaken}


SCORES: dict[str, Callable[[list[tuple[Encounter, Row]]], Row]] = {
    STEP_OUT: step_outs,
    BYSTANDER: bystanders,
    CYCLIST: cyclists,
}


def by_distance(driven: Iterable[tuple[Encounter, Row]]) -> dict[str, Row]:
    """The speeds beside bystanders, by their distance from the lane centre."""
    driven, found = list(driven), {}
    for low, high in GAPS_M:
        some = [(c, row) for c, row in driven if low <= c.aside_m < high]
        speeds = np.array([row["passing_mps"] for _, row in some], float)
        speeds = speeds[np.isfinite(speeds)]
        set_mps = [case.scenario["speed_mps"] for case, _ in some]
        if len(speeds):
            found[f"{low:g} to {high:g} m"] = {
                "runs": len(some),
                "set speed, median [m/s]": round(float(np.median(set_mps)), 1),
                "speed beside, median [m/s]": round(float(np.median(speeds)), 1),
                "speed beside, greatest [m/s]": round(float(speeds.max()), 1),
            }
    return found
