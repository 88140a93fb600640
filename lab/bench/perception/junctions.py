"""Straight on past side roads: ten shapes of their mouths, drives with pixels.

A shape is a kind of junction: its corners, lines and kerbs, one or both sides, traffic that keeps right or left,
with and without lines on the main road. Widths, radii, the place, the start and the speed are random. What is
judged is the lane: the car drives straight on or stops, it does not turn into the side road.

Every drive is one line in ``runs/junctions_<seed>.jsonl``; stored ones are not repeated, so that an interrupted
benchmark continues.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.store import Row, stored_rows
from trepid.config import WORK_DIR

PLACE_M, WAY_M = 45.0, 70.0  # of the axis of the side road; driven at most
SECONDS = 30.0
COUNT, QUICK_COUNT = 100, 10
TARGETS = "target: departures 0 in 100 drives: straight on or a stop"

NO_LINE = {"stroke": "none"}
MARKED: dict[str, Any] = {"left": {"stroke": "dashed"}, "right": {"stroke": "solid"}}
BARE: dict[str, Any] = {
    **dict.fromkeys(("left", "right", "far_left"), NO_LINE),
    "paved_left_m": 0,
    "paved_right_m": 0,
}
KERBED: dict[str, Any] = {
    "left": {"stroke": "dashed", "dash_m": 3, "gap_m": 3},
    "right": NO_LINE,
    "far_left": NO_LINE,
    "left_lanes": [{}],
    "paved_left_m": 0.4,
    "paved_right_m": 0.4,
    "edge_roughness_m": 0,
    "kerb_m": 0.25,
    "verge": "pavement",
}
SHAPES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "driveway between lines": (MARKED, {"kind": "driveway", "side": "right"}),
    "driveway without lines": (BARE, {"kind": "driveway", "side": "left"}),
    "kerb around the corners": (KERBED, {"kind": "intersection", "side": "right", "kerb_m": 0.25}),
    "kerbs, both sides": (
        KERBED,
        {"kind": "intersection", "side": "both", "kerb_m": 0.25, "mouth_line": "give_way"},
    ),
    "kerb, give-way line, left-hand": (
        KERBED,
        {"kind": "driveway", "side": "left", "kerb_m": 0.25, "mouth_line": "give_way", "left_hand": True},
    ),
    "edge line around the corners": (MARKED, {"kind": "intersection", "side": "right", "rim_line": True}),
    "edge lines, both sides": (
        MARKED,
        {"kind": "intersection", "side": "both", "rim_line": True, "centre_line": True},
    ),
    "edge line, stop line, left-hand": (
        MARKED,
        {"kind": "intersection", "side": "left", "rim_line": True, "mouth_line": "stop", "left_hand": True},
    ),
    "crossing without lines": (BARE, {"kind": "intersection", "side": "both"}),
    "gravel beside lines": (MARKED, {"kind": "intersection", "side": "right", "surface": "gravel"}),
}


class Passage(NamedTuple):
    """One drive past a side road."""

    shape: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Its name in the store."""
        return f"{self.shape} {self.number} {self.seed}"


def bench_junctions(
    seed: int, quick: bool = False, count: int | None = None, jobs: int | None = None
) -> dict[str, Any]:
    """Departures, stops and lateral error by the shape of the mouth. ``count``: of drives, in turn by shape."""
    total, names = count or (QUICK_COUNT if quick else COUNT), list(SHAPES)
    drives = [Passage(names[number % len(names)], number, seed) for number in range(total)]
    path = WORK_DIR / "runs" / f"junctions_{seed}.jsonl"
    rows = stored_rows(path, driven_row, {drive.key: drive for drive in drives}, jobs=jobs)
    return summary(rows)


def scenario_of(drive: Passage) -> Scenario:
    """A drive on a straight road past a side road of random width, radius and place."""
    rng = np.random.default_rng((drive.seed, 5310, drive.number))
    appearance, junction = SHAPES[drive.shape]
    place = {
        "at_m": PLACE_M + float(rng.uniform(-5.0, 5.0)),
        "width_m": float(rng.uniform(4.0, 10.0)),
        "radius_m": float(rng.uniform(2.0, 10.0)),
    }
    return Scenario.model_validate(
        {
            "name": "junction",
            "description": f"straight on past a side road: {drive.shape}",
            "tags": ["marking"],
            "road": "straight",
            "segments": [{"length_m": PLACE_M + 60.0}],
            "junctions": [{**junction, **place}],
            "appearance": appearance,
            "start": {"speed_mps": 5.0, "offset_m": float(rng.uniform(-0.3, 0.3))},
            "speed_mps": float(rng.uniform(4.0, 9.0)),
            "duration_s": SECONDS,
            "distance_m": WAY_M,
        }
    )


def driven_row(drive: Passage) -> Row:
    """The stored row of a drive."""
    result = run(scenario_of(drive), seed=drive.number)
    return {
        "shape": drive.shape,
        "finished": bool(result.trace["finished"][-1]),
        "departures": result.metrics.departures,
        "largest_offset_m": result.metrics.max_lateral_error_m,
        "max_fear": result.metrics.max_fear,
    }


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """The tables of the drives, and one line for all."""
    shapes = {shape: [row for row in rows if row["shape"] == shape] for shape in SHAPES}
    return {
        "all drives": _scores(rows),
        "by shape": {shape: _scores(some) for shape, some in shapes.items() if some},
        "targets": TARGETS,
    }


def _scores(rows: Iterable[Row]) -> Row:
    some = list(rows)
    return {
        "drives": len(some),
        "past": sum(row["finished"] for row in some),
        "departures": sum(row["departures"] for row in some),
        "largest_offset_m": round(max(row["largest_offset_m"] for row in some), 3),
        "greatest_fear": round(max(row["max_fear"] for row in some), 3),
    }
