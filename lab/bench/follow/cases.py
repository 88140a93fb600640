"""Random cases of following with the lanes lost: one seed, one case."""

import math
from enum import StrEnum
from typing import Any

import numpy as np

from lab.bench.drawn_cases import drawn_scenario, random_shape
from sim_harness.scenarios.scenario import Scenario

CRUISE_MPS = 8.0
STRAIGHT_M = 50.0  # before the first bend
ROAD_M = 260.0
ENTRY_RATE_1PM2 = 0.003  # κ' of the spirals: 0.6 m/s³ at 6 m/s
RADII_M = (25.0, 250.0)
MAX_HEADING_RAD = 1.2
BACK_S = 3.0  # of visible road after its loss


class Kind(StrEnum):
    """Action of the leader while the lanes are lost."""

    DRIVES = "drives"
    STOPS = "stops"
    BRAKES_HARD = "brakes_hard"
    LEAVES_ROAD = "leaves_road"
    CUT_IN = "cut_in"
    CUT_OUT = "cut_out"


def case(seed: int, *, rendered: bool) -> tuple[Kind, Scenario]:
    """The case of ``seed``, with rendered images and the detector, or with its model."""
    rng = np.random.default_rng((seed, 40))
    kinds = list(Kind)
    kind = kinds[int(rng.choice(len(kinds), p=(0.4, 0.12, 0.12, 0.12, 0.12, 0.12)))]
    speed_mps, gap_m = float(rng.uniform(2.0, 5.0)), float(rng.uniform(7.0, 14.0))
    lost_s = float(rng.uniform(2.0, 4.0))
    back_s = lost_s + float(rng.uniform(5.0, 9.0))
    doing_s = lost_s + float(rng.uniform(1.0, 4.0))
    traffic = _traffic(kind, rng, speed_mps=speed_mps, gap_m=gap_m, doing_s=doing_s)
    scenario = drawn_scenario(
        f"follow_{kind}_{seed}",
        f"the lanes are lost behind a leader; it: {kind}",
        rendered=rendered,
        start_mps=speed_mps,
        segments=random_segments(rng),
        speed_mps=speed_mps if kind is Kind.CUT_IN else CRUISE_MPS,
        traffic=traffic,
        faults=[{"kind": "lost_lane", "from_s": lost_s, "to_s": back_s}],
        duration_s=back_s + BACK_S,
    )
    return kind, scenario


def _traffic(
    kind: Kind, rng: np.random.Generator, *, speed_mps: float, gap_m: float, doing_s: float
) -> tuple[dict[str, Any], ...]:
    leader: dict[str, Any] = {"gap_m": gap_m, "speed_mps": speed_mps, "offset_m": float(rng.normal(0, 0.1))}
    leader["shape"] = random_shape(rng)
    side = float(rng.choice([-1.0, 1.0]))
    over_s = float(rng.uniform(2.0, 4.0))
    match kind:
        case Kind.STOPS:
            phases = [{"kind": "change_speed", "at_s": doing_s, "to_mps": 0.0, "rate_mps2": 1.5}]
        case Kind.BRAKES_HARD:
            phases = [{"kind": "change_speed", "at_s": doing_s, "to_mps": 0.0, "rate_mps2": 4.0}]
        case Kind.LEAVES_ROAD:
            out_m = side * float(rng.uniform(4.0, 8.0))
            phases = [
                {"kind": "change_lane", "at_s": doing_s, "to_offset_m": out_m, "over_s": over_s},
                {"kind": "change_speed", "at_s": doing_s + over_s, "to_mps": 0.0, "rate_mps2": 2.0},
            ]
        case Kind.CUT_OUT:
            phases = [{"kind": "change_lane", "at_s": doing_s, "to_lane": 1, "over_s": over_s}]
        case _:
            phases = []
    others: list[dict[str, Any]] = []
    if kind is Kind.CUT_IN:
        cutting = {"kind": "change_lane", "at_s": doing_s, "to_lane": 0, "over_s": over_s}
        # The other car is ahead and faster: no brake can avoid a cut-in beside the ego vehicle.
        others = [
            {"gap_m": gap_m / 2 - 2.5, "lane": 1, "speed_mps": speed_mps + 0.5, "phases": [cutting]},
        ]
        leader["gap_m"] = gap_m + 3.0
    return ({**leader, "phases": phases}, *others)


def random_segments(rng: np.random.Generator) -> tuple[dict[str, Any], ...]:
    """A straight, then bends to both sides, joined by spirals."""
    segments: list[dict[str, Any]] = [{"length_m": STRAIGHT_M}]
    length_m, curvature, heading = STRAIGHT_M, 0.0, 0.0
    while length_m < ROAD_M:
        radius_m = RADII_M[0] * (RADII_M[1] / RADII_M[0]) ** float(rng.random())
        goal = 0.0 if rng.random() < 0.2 else float(rng.choice([-1.0, 1.0])) / radius_m
        spiral_m = max(abs(goal - curvature) / ENTRY_RATE_1PM2, 5.0)
        arc_m = float(rng.uniform(10.0, 40.0))
        after = heading + spiral_m * (curvature + goal) / 2 + arc_m * goal
        if abs(after) > MAX_HEADING_RAD:
            goal = -math.copysign(abs(goal), heading)
            spiral_m = max(abs(goal - curvature) / ENTRY_RATE_1PM2, 5.0)
            after = heading + spiral_m * (curvature + goal) / 2 + arc_m * goal
        segments.append({"length_m": spiral_m, "curvature_1pm": (curvature, goal)})
        segments.append({"length_m": arc_m, "curvature_1pm": goal})
        curvature, heading, length_m = goal, after, length_m + spiral_m + arc_m
    return tuple(segments)
