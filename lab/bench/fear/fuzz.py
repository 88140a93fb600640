"""Broken numbers in messages: fear never falls below that of the intact messages, and no exception is raised.

There are calm and risky situations, because a fear of 0 cannot fall. In each, every number of every message is once
NaN, infinite and far beyond its range; then several random numbers are broken at once.
"""

import math
import random
import typing
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from supervisor.rules.inference import FearRules
from supervisor.situation.world_state import WorldStateObserver
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, load
from trepid.messages import ImageStatistics, LeadVehicle, RoadUsers, SteeringEstimate, VehicleState

MESSAGES = 10_000
WARM_UP = 3  # frames before the broken one
PERIOD_S, AGE_S = 0.04, 0.03
BROKEN = (math.nan, math.inf, -math.inf, 1e30, -1e30)
NOT_FEARED = {"latency_ms", "road_wheel_angle_rad"}  # fields of an estimate for display only
Messages = dict[str, Any]


def situations() -> dict[str, Messages]:
    """Messages of calm and of risky situations, with stamps around t = 0."""
    estimate = SteeringEstimate(
        t_s=0.0,
        estimator="cv",
        lateral_offset_m=0.1,
        heading_error_rad=0.01,
        curvature_1pm=0.002,
        curvature_rate_1pm2=0.0001,
        lookahead_m=8.0,
        road_wheel_angle_rad=0.0,
        confidence=0.9,
        lanes_detected=2,
        lane_width_m=3.4,
        reason="",
        marked=True,
        ahead_sigma_m=(0.05, 0.05, 0.1, 0.2, 0.4, 0.8),
    )
    calm: Messages = {
        "cv": estimate,
        "cnn": replace(estimate, estimator="cnn", lanes_detected=0, lane_width_m=None, marked=None),
        "statistics": ImageStatistics(
            t_s=0.0,
            brightness=0.45,
            contrast=0.15,
            over_exposed=0.01,
            under_exposed=0.01,
            sharpness=200.0,
            frozen_s=0.0,
            spots=0.0,
        ),
        "lead": LeadVehicle(t_s=0.0, distance_m=30.0, lateral_m=0.2, speed_mps=8.0, confidence=0.9),
        "road_users": RoadUsers(
            t_s=0.0,
            kinds=("cyclist", "person"),
            x_m=(35.0, 40.0),
            y_m=(9.0, -8.0),
            x_mps=(4.0, 0.0),
            y_mps=(0.0, 0.0),
            confidences=(0.9, 0.9),
            detects=("person", "cyclist", "animal"),
        ),
        "state": VehicleState(
            t_s=0.0, speed_mps=8.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        ),
    }
    unsure = {name: replace(calm[name], confidence=0.45) for name in ("cv", "cnn")}
    return {
        "calm": calm,
        "unsure": calm | unsure,
        "dim": calm | {"statistics": replace(calm["statistics"], brightness=0.09, under_exposed=0.5)},
        "apart": calm | {"cnn": replace(calm["cnn"], lateral_offset_m=0.6)},
        "off centre": calm | {n: replace(calm[n], lateral_offset_m=0.65) for n in ("cv", "cnn")},
        "narrow": calm | {"cv": replace(calm["cv"], lane_width_m=2.3)},
        "close behind": calm | {"lead": replace(calm["lead"], distance_m=5.0)},
        "short sight": calm
        | {
            "statistics": replace(
                calm["statistics"], sight_m=30.0, sight_sigma_m=2.0, sight_cause=Cause.FOG.value
            )
        },
        "a person in the way": calm
        | {"road_users": replace(calm["road_users"], x_m=(35.0, 16.0), y_m=(9.0, 0.2))},
        "fast": calm | {"state": replace(calm["state"], speed_mps=20.0)},
        "vague": calm
        | {
            "cnn": replace(calm["cnn"], curvature_1pm=0.006, ahead_sigma_m=(0.3, 0.3, 0.5, 2.0, 4.0, 8.0)),
            "state": replace(calm["state"], speed_mps=25.0),
        },
    }


class Afraid:
    """Fear of a situation whose last messages are broken."""

    def __init__(self) -> None:
        self._rules = FearRules.load(CONFIG_DIR / "fear.yaml")
        self._settings = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
        self._vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)

    def fear(self, whole: Messages, broken: Messages) -> float:
        """Fear at the last of a few frames, of which only the last is ``broken``."""
        s = self._settings
        observer = WorldStateObserver(
            *(s.validation, s.fusion, s.follow, s.giving_way, s.sight), self._vehicle
        )
        for number in range(WARM_UP + 1):
            messages = broken if number == WARM_UP else whole
            t_s = PERIOD_S * number
            # Stamps are counted from t = 0 of the situation; a broken one stays broken.
            now = {name: replace(message, t_s=message.t_s + t_s) for name, message in messages.items()}
            world = observer.step(
                self._rules,
                {name: now[name] for name in ("cv", "cnn")},
                now["statistics"],
                now["lead"],
                now["state"],
                now_s=t_s + AGE_S,
                road_users=now["road_users"],
            )
        return self._rules.evaluate(world.features).fear


def numbers(message: Any) -> list[str]:
    """Names of the fields of ``message`` with one float or several, optional ones included."""
    hints, floats = typing.get_type_hints(type(message)), (float, float | None, tuple[float, ...])
    named = [f.name for f in fields(message) if hints[f.name] in floats]
    return [name for name in named if not (isinstance(message, SteeringEstimate) and name in NOT_FEARED)]


def spoilt(message: Any, name: str, value: float) -> Any:
    """``message`` with ``value`` in the field ``name``; of several floats, in place of the last."""
    now = getattr(message, name)
    return replace(message, **{name: (*now[:-1], value) if isinstance(now, tuple) else value})


def one_by_one(whole: Messages) -> Iterator[Messages]:
    """Every number of every message broken in every way, one at a time."""
    for sender, message in whole.items():
        for name in numbers(message):
            if getattr(message, name) is not None:
                for value in BROKEN:
                    yield whole | {sender: spoilt(message, name, value)}


def at_random(whole: Messages, rng: random.Random) -> Messages:
    """One to five numbers broken, anywhere."""
    broken = dict(whole)
    for _ in range(rng.randint(1, 5)):
        sender = rng.choice(list(broken))
        name = rng.choice([n for n in numbers(broken[sender]) if getattr(broken[sender], n) is not None])
        broken[sender] = spoilt(broken[sender], name, rng.choice(BROKEN))
    return broken


def is_lower(clean: float, fear: float) -> bool:
    """Whether ``fear`` is below ``clean`` or NaN."""
    return not fear >= clean - 1e-12


def bench_fuzz(seed: int) -> dict[str, Any]:
    """Number of broken messages, and of those that lowered fear; an exception ends the benchmark."""
    afraid, rng = Afraid(), random.Random(seed)
    whole = situations()
    clean = {name: afraid.fear(messages, messages) for name, messages in whole.items()}
    singles = [(name, broken) for name, messages in whole.items() for broken in one_by_one(messages)]
    several = [
        (name, at_random(whole[name], rng)) for name in (rng.choice(list(whole)) for _ in range(MESSAGES))
    ]
    rows: dict[str, Any] = {f"clean fear, {name}": round(fear, 3) for name, fear in clean.items()}
    for what, cases in (("one number broken", singles), ("several broken", several)):
        calmed = sum(is_lower(clean[name], afraid.fear(whole[name], broken)) for name, broken in cases)
        rows[what] = f"{len(cases)} cases, {calmed} below the clean value, target 0; no exception"
    return rows
