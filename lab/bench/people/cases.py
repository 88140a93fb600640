"""Random encounters: road users that step out, that stand at the edge, and cyclists that ride ahead.

A step-out is one that a car can stop for: when the road user starts, or comes out from behind a parked van, the
way to it is at least v·ρ + v²/(2·a) with the reaction time and the strongest deceleration below. It then stands in
the lane for a while, so that the car must stop, and walks on.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_harness.scenarios.road_users import START_RATE_MPS2
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.scene.people import FIGURES, Shape

REACTION_S = 0.7  # latency 0.1, detection 0.2, brakes 0.3; a frame to spare
STRONGEST_MPS2 = 4.0  # UN R157 5.3
TOUCH_M = 0.5  # from the bumper
SPEEDS_MPS = (4.0, 12.0)  # set speeds
STEP_SPEEDS_MPS = {
    Shape.ADULT: (0.8, 2.2),
    Shape.CHILD: (1.0, 2.2),
    Shape.CYCLIST: (1.5, 3.0),
    Shape.DOG: (1.0, 3.0),
}
"""Euro NCAP AEB VRU: 1.4 walking, 2.2 running."""
STANDS_S = 12.0  # in the lane: a stop from afar takes 8 s
AT_M = (60.0, 80.0)  # from the bumper at the start to the encounter
VAN_ASIDE_M, VAN_HALF_M = 2.9, 1.0  # of parked vans: from the lane centre, and half their width
STEP_OUT, BYSTANDER, CYCLIST = KINDS = ("step-out", "bystander", "cyclist ahead")


@dataclass(frozen=True, slots=True)
class Encounter:
    """One encounter."""

    kind: str
    scenario: dict[str, Any]  # without sight and sensor
    aside_m: float  # lateral distance of the road user from the lane centre at the start
    hidden: bool = False  # by a parked van


def cases(kind: str, seed: int, count: int) -> list[Encounter]:
    """``count`` random cases of a kind."""
    drawn = {STEP_OUT: _step_out, BYSTANDER: _bystander, CYCLIST: _cyclist}[kind]
    rngs = [np.random.default_rng([seed, 48, KINDS.index(kind), number]) for number in range(count)]
    return [drawn(rng, number) for number, rng in enumerate(rngs)]


def build_scenario(case: Encounter, **fields: Any) -> Scenario:
    """The scenario of a case with further ``fields``."""
    return Scenario.model_validate({**case.scenario, **fields})


def walk_s(way_m: float, speed_mps: float) -> float:
    """Time from standstill over ``way_m`` at an acceleration of START_RATE_MPS2 up to ``speed_mps``."""
    if way_m <= speed_mps**2 / (2 * START_RATE_MPS2):
        return math.sqrt(2 * way_m / START_RATE_MPS2)
    return way_m / speed_mps + speed_mps / (2 * START_RATE_MPS2)


def _base(rng: np.random.Generator, *, duration_s: float) -> dict[str, Any]:
    speed_mps = float(rng.uniform(*SPEEDS_MPS))
    return dict(
        name="people",
        description="an encounter",
        tags=["traffic"],
        road="straight",
        duration_s=duration_s,
        speed_mps=round(speed_mps, 2),
        start={"speed_mps": round(speed_mps, 2)},
    )


def _step_out(rng: np.random.Generator, number: int) -> Encounter:
    base = _base(rng, duration_s=50.0)
    side, hidden = float(rng.choice([-1.0, 1.0])), number % 2 == 1
    shape = list(STEP_SPEEDS_MPS)[int(rng.integers(len(STEP_SPEEDS_MPS)))]
    walk_mps = float(rng.uniform(*STEP_SPEEDS_MPS[shape]))
    at_m = float(rng.uniform(*AT_M))
    aside_m = VAN_ASIDE_M + 0.3 if hidden else float(rng.uniform(1.8, 4.0))
    speed_mps = base["speed_mps"]
    # the way that the car needs from the first sight of a step on, and what it drives until then
    until_s = walk_s(aside_m - (VAN_ASIDE_M - VAN_HALF_M), walk_mps) if hidden else 0.0
    needed_m = speed_mps * REACTION_S + speed_mps**2 / (2 * STRONGEST_MPS2) + TOUCH_M
    half_m = FIGURES[shape].width_m / 2
    trigger_m = needed_m + half_m + speed_mps * until_s + float(rng.uniform(0.0, 8.0))
    user = dict(
        gap_m=max(at_m, trigger_m + 25.0),
        offset_m=side * aside_m,
        facing_rad=-side * math.pi / 2,
        shape=shape.value,
        phases=[
            dict(kind="cross", at_gap_m=trigger_m, to_offset_m=side * 0.2, speed_mps=walk_mps),
            dict(kind="cross", after_s=STANDS_S, to_offset_m=-side * 5.0, speed_mps=1.4),
        ],
    )
    if hidden:
        van = dict(gap_m=user["gap_m"] - 6.5, offset_m=side * VAN_ASIDE_M, shape="van")
        base |= dict(traffic=[van], appearance={"paved_right_m": 2.5, "paved_left_m": 2.5})
    return Encounter(STEP_OUT, base | dict(road_users=[user]), aside_m, hidden)


def _bystander(rng: np.random.Generator, number: int) -> Encounter:
    base = _base(rng, duration_s=40.0)
    aside_m = float(rng.uniform(1.7, 6.0))
    user = dict(
        gap_m=float(rng.uniform(*AT_M)),
        offset_m=float(rng.choice([-1.0, 1.0])) * aside_m,
        facing_rad=float(rng.uniform(-3.0, 3.0)),
        shape=str(rng.choice([Shape.ADULT.value, Shape.CHILD.value, Shape.DOG.value])),
    )
    return Encounter(BYSTANDER, base | dict(road_users=[user]), aside_m)


def _cyclist(rng: np.random.Generator, number: int) -> Encounter:
    base = _base(rng, duration_s=35.0)
    aside_m = float(rng.uniform(-1.4, 0.0))
    user = dict(
        gap_m=float(rng.uniform(25.0, 50.0)),
        offset_m=aside_m,
        speed_mps=float(rng.uniform(2.0, 5.0)),
        shape=Shape.CYCLIST.value,
    )
    return Encounter(CYCLIST, base | dict(road_users=[user]), abs(aside_m))
