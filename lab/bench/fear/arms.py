"""Baselines without fear: one estimator, the plain average, the most confident one, or the fused path."""

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from statistics import fmean
from typing import Any

from sim_harness.lockstep.unsupervised import LANE, Choice, Estimates, FollowedLane
from trepid.messages import Decision, SteeringEstimate


class Driver(StrEnum):
    """The followed lane."""

    CV = "cv"
    CNN = "cnn"
    AVERAGE = "average"
    SUREST = "surest"
    FUSED = "fused"  # the supervisor's path without its fear


def choice_of(driver: Driver) -> Choice:
    """The lane that ``driver`` follows from now on."""

    def choice(supervised: Decision, estimates: Estimates) -> FollowedLane | None:
        if driver is Driver.FUSED:
            return None if supervised.path_t_s is None else FollowedLane.of(supervised, supervised.path_t_s)
        seen = {name: e for name, e in estimates.items() if e is not None and e.lateral_offset_m is not None}
        lane = chosen(seen, driver)
        return None if lane is None else FollowedLane.of(lane, lane.t_s)

    return choice


def chosen(seen: Mapping[str, SteeringEstimate], driver: Driver) -> SteeringEstimate | None:
    """The lane that ``driver`` follows, from the estimates with a lane."""
    if driver is Driver.SUREST:
        return max(seen.values(), key=lambda e: e.confidence, default=None)
    if driver is Driver.AVERAGE and seen:
        newest = max(seen.values(), key=lambda e: e.t_s)
        mean: dict[str, Any] = {name: fmean(getattr(e, name) for e in seen.values()) for name in LANE}
        return replace(newest, **mean)
    return seen.get(driver)
