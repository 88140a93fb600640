"""`trepid bench within-sight`: standing and slow vehicles where the sight is short, at set speeds of 5 to 25 m/s.

A case is a road, what takes the sight, a vehicle beyond it, and a set speed, all drawn from one seed. It is driven
with rendered images, both estimators and the camera's detector (``rendered``), or with the true lane, the true
sight and the modelled detector, which sees nothing beyond that sight (``modelled``). The tables of what takes the
sight, KINDS, and of what stands there, OBSTACLES, may get further rows.

The same set speeds on a clear straight road without other vehicles show the cost: the loss of mean speed.

Every drive is one line in ``runs/within_sight_<seed>.jsonl``: an interrupted benchmark continues.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from lab.bench.drawn_cases import drawn_scenario, random_shape
from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.plan import PlanStore, plan
from sim_harness.sweep.sweep import sweep, workforce
from trepid.config import WORK_DIR

Row = dict[str, Any]
Changes = dict[str, Any]
Draw = Callable[[np.random.Generator], Changes]
"""Fields of a scenario, drawn at random."""

RENDERED, MODELLED, CLEAR_SPEEDS = 300, 1200, 5
QUICK_RENDERED, QUICK_MODELLED = 10, 50
SET_MPS, START_MPS, SLOW_MPS = (5.0, 25.0), 4.0, (0.5, 4.0)
SLOW_SHARE = 0.3
BEFORE_M, WAITING_S, CREEP_MPS = (100.0, 180.0), 12.0, 2.5
ROAD_M = 900.0
CLEAR_S = 20.0
MOST_DECEL_MPS2 = 4.0  # UN R157 5.3; the figures allow for the rounding of a differentiated speed
STEEPER_MPS2 = 0.05


def _weather(kind: str, low: float, high: float) -> Draw:
    def draw(rng: np.random.Generator) -> Changes:
        return {"disturbances": [{"kind": kind, "grade": float(rng.uniform(low, high))}]}

    return draw


def _crest(rng: np.random.Generator) -> Changes:
    """Over a crest of radius R a camera 1.45 m high sees √(2·1.45·R): 34 to 66 m."""
    radius_m, grade = float(rng.uniform(400.0, 1500.0)), float(rng.uniform(0.03, 0.06))
    top_m = 140.0
    half_m = radius_m * grade
    profile = [(top_m - half_m - 60.0, 0.0), (top_m - half_m, grade), (top_m + half_m, -grade)]
    last = (top_m + half_m + 60.0, 0.0)
    points = [{"at_m": max(at_m, 0.0), "grade": slope} for at_m, slope in (*profile, last)]
    return {"elevation": points, "beyond_m": top_m + float(rng.uniform(0.0, half_m))}


def _wall(rng: np.random.Generator) -> Changes:
    """A bend with a wall on its inside."""
    side = float(rng.choice([-1.0, 1.0]))
    bend_1pm = side / float(rng.uniform(50.0, 120.0))
    segments: list[Changes] = [{"length_m": 80.0}, {"length_m": 25.0, "curvature_1pm": (0.0, bend_1pm)}]
    segments += [
        {"length_m": 80.0, "curvature_1pm": bend_1pm},
        {"length_m": 25.0, "curvature_1pm": (bend_1pm, 0.0)},
    ]
    wall = {"kind": "stone", "side": "left" if side > 0 else "right", "from_m": 60.0, "to_m": 210.0}
    wall["distance_m"] = float(rng.uniform(0.6, 2.5)) + 3.5 * (side > 0)
    straight = [*segments, {"length_m": ROAD_M}]
    return {"segments": straight, "walls": [wall], "beyond_m": float(rng.uniform(120.0, 180.0))}


KINDS: dict[str, Draw] = {
    "fog": _weather("fog", 3.0, 5.0),  # 100 to 25 m
    "night": _weather("night", 2.0, 5.0),
    "rain": _weather("rain", 2.0, 5.0),
    "crest": _crest,
    "wall": _wall,
}
"""What takes the sight."""


def _vehicle(rng: np.random.Generator) -> Changes:
    speed_mps = float(rng.uniform(*SLOW_MPS)) if rng.random() < SLOW_SHARE else 0.0
    shape = random_shape(rng)
    return {"traffic": [{"speed_mps": speed_mps, "shape": shape, "offset_m": float(rng.normal(0.0, 0.15))}]}


OBSTACLES: dict[str, Draw] = {"vehicle": _vehicle}
"""What stands or drives beyond the sight."""


def case(seed: int, kind: str, number: int, *, rendered: bool) -> Case:
    """The case ``number`` of a ``kind`` of lost sight."""
    rng = np.random.default_rng((seed, 48, number, *kind.encode()))
    fields = {"segments": [{"length_m": ROAD_M}], **KINDS[kind](rng)}
    name = str(rng.choice(list(OBSTACLES)))
    fields |= OBSTACLES[name](rng)
    gap_m = float(fields.pop("beyond_m", rng.uniform(*BEFORE_M)))
    (vehicle,) = fields["traffic"]
    slow_mps = float(vehicle["speed_mps"])
    vehicle["gap_m"] = gap_m - slow_mps * 0.6 * gap_m / 10.0 if slow_mps else gap_m
    vehicle["gap_m"] = max(vehicle["gap_m"], 40.0)
    scenario = drawn_scenario(
        f"{'rendered' if rendered else 'modelled'} {kind}",
        f"a {name} beyond the sight: {kind}",
        rendered=rendered,
        start_mps=START_MPS,
        speed_mps=float(rng.uniform(*SET_MPS)),
        duration_s=gap_m / CREEP_MPS / 2.0 + WAITING_S,
        **fields,
    )
    return Case(scenario=scenario, index=number, seed=int(rng.integers(2**31)), parameters={})


def clear(number: int, *, rendered: bool) -> Case:
    """A clear straight road at one of CLEAR_SPEEDS set speeds, from this speed on."""
    set_mps = SET_MPS[0] + (SET_MPS[1] - SET_MPS[0]) * number / (CLEAR_SPEEDS - 1)
    scenario = drawn_scenario(
        f"{'rendered' if rendered else 'modelled'} clear",
        "a clear road",
        rendered=rendered,
        start_mps=set_mps,
        speed_mps=set_mps,
        segments=[{"length_m": ROAD_M}],
        tags=["nominal"],
        lead_sensor=None,
        duration_s=CLEAR_S,
    )
    return Case(scenario=scenario, index=number, seed=number, parameters={})


def bench_within_sight(
    seed: int, *, count: int | None = None, jobs: int = 1, quick: bool = False
) -> dict[str, Any]:
    """Collisions, greatest decelerations, and the loss of mean speed on clear roads.

    ``count``: rendered cases, and four times as many modelled ones.
    """
    rendered = count or (QUICK_RENDERED if quick else RENDERED)
    modelled = 4 * count if count else QUICK_MODELLED if quick else MODELLED
    kinds = list(KINDS)
    drawn = [
        case(seed, kinds[number % len(kinds)], number, rendered=images)
        for images, cases in ((False, modelled), (True, rendered))
        for number in range(cases)
    ]
    drawn += [clear(number, rendered=images) for images in (False, True) for number in range(CLEAR_SPEEDS)]
    planned = plan(drawn)
    path = WORK_DIR / "runs" / f"within_sight_{seed}.jsonl"
    with PlanStore(path, planned, code=fingerprint(), resume=True) as store:
        rows = {key: outcome.row for key, outcome in sweep(planned, workforce(jobs=jobs), store)}
    return summary([(planned[key], row) for key, row in rows.items()])


def summary(driven: Iterable[tuple[Case, Row]]) -> dict[str, Any]:
    """The tables of the benchmark from its cases and their rows."""
    driven = list(driven)
    names = dict.fromkeys(case.scenario.name for case, _ in driven)
    found = {name: [(c, row) for c, row in driven if c.scenario.name == name] for name in names}
    obstacles = {name: figures(of) for name, of in found.items() if not name.endswith("clear")}
    roads = {
        f"{name} at {case.scenario.speed_mps:g} m/s": {"loss_of_mean_speed_percent": loss_percent(case, row)}
        for name, of in found.items()
        for case, row in of
        if name.endswith("clear")
    }
    return {"vehicles beyond the sight": obstacles, "clear roads": roads}


def figures(driven: Iterable[tuple[Case, Row]]) -> Row:
    """Counts over the drives of one row; a drive that crashed counts as a collision."""
    rows = [row for _, row in driven]
    decels_mps2 = [row["max_decel_mps2"] for row in rows if row["max_decel_mps2"] is not None]
    hits = [(c, row) for c, row in driven if row["collisions"] is None or row["collisions"] > 0]
    steep = [decel for decel in decels_mps2 if decel > MOST_DECEL_MPS2 + STEEPER_MPS2]
    return {
        "cases": len(rows),
        "collisions": len(hits),
        "collided_at_set_mps": ", ".join(f"{c.scenario.speed_mps:.1f}" for c, _ in hits),
        "greatest_decel_mps2": round(max(decels_mps2, default=math.nan), 2),
        "beyond_4_mps2": len(steep),
        "departures": sum(row["departures"] or 0 for row in rows),
        "mean_speed_mps": round(float(np.mean([row["mean_speed_mps"] or 0.0 for row in rows])), 2),
    }


def loss_percent(case: Case, row: Row) -> float | None:
    """The mean speed below the set speed [%]; None for a drive that crashed."""
    if row["mean_speed_mps"] is None or case.scenario.speed_mps is None:
        return None
    return round(100.0 * (1.0 - row["mean_speed_mps"] / case.scenario.speed_mps), 2)
