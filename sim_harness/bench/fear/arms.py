"""Baselines without fear: one estimator, the plain average, the most confident one, or the fused path."""

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from statistics import fmean
from typing import Any, NamedTuple, Self

from supervisor.modes.modes import STARTING
from supervisor.rules.inference import CALM
from supervisor.supervisor import Supervisor
from trepid.messages import (
    Decision,
    ImageStatistics,
    LeadVehicle,
    Mode,
    SteeringEstimate,
    Stop,
    VehicleState,
)

LANE = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2")


class Driver(StrEnum):
    """The followed lane."""

    CV = "cv"
    CNN = "cnn"
    AVERAGE = "average"
    SUREST = "surest"
    FUSED = "fused"  # the supervisor's path without its fear


class FollowedLane(NamedTuple):
    """A followed lane."""

    t_s: float
    lookahead_m: float
    lane: dict[str, float | None]  # the fields LANE

    @classmethod
    def of(cls, message: SteeringEstimate | Decision, t_s: float) -> Self:
        """The lane of ``message``, valid at ``t_s``."""
        return cls(t_s, message.lookahead_m, {name: getattr(message, name) for name in LANE})


class UnsupervisedDriver:
    """Follows the lane of ``driver`` at cruise speed; the fear of a supervisor is recorded but has no effect.

    Without an estimate it follows the last lane and does not stop.
    """

    def __init__(self, supervisor: Supervisor, driver: Driver, *, cruise_speed_mps: float) -> None:
        self._supervisor, self._driver, self._cruise_speed_mps = supervisor, driver, cruise_speed_mps
        self._followed: FollowedLane | None = None

    def step(
        self,
        estimates: Mapping[str, SteeringEstimate | None],
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
    ) -> Decision:
        """The decision of the driver, with the fear of the supervisor."""
        supervised = self._supervisor.step(estimates, statistics, lead, state, now_s=now_s)
        followed = self._followed = self._chosen(supervised, estimates) or self._followed
        if followed is None:
            nowhere: dict[str, Any] = dict.fromkeys(("path_t_s", *LANE))
            halt: dict[str, Any] = dict(mode=Mode.STOP, stop=Stop.COMFORT, path_source="none")
            return replace(supervised, **halt, **nowhere, speed_factor=0.0, speed_cap_mps=0.0)
        lane: dict[str, Any] = followed.lane
        return replace(
            supervised,
            mode=Mode.KEEP,
            stop=Stop.NONE,
            path_t_s=followed.t_s,
            lookahead_m=followed.lookahead_m,
            path_source=str(self._driver),
            cause=CALM
            if supervised.cause == STARTING
            else supervised.cause,  # this driver has no start condition
            speed_factor=1.0,
            speed_cap_mps=self._cruise_speed_mps,
            **lane,
        )

    def _chosen(
        self, supervised: Decision, estimates: Mapping[str, SteeringEstimate | None]
    ) -> FollowedLane | None:
        """The lane that the driver follows from now on; None without one."""
        if self._driver is Driver.FUSED:
            return None if supervised.path_t_s is None else FollowedLane.of(supervised, supervised.path_t_s)
        seen = {name: e for name, e in estimates.items() if e is not None and e.lateral_offset_m is not None}
        lane = chosen(seen, self._driver)
        return None if lane is None else FollowedLane.of(lane, lane.t_s)


def chosen(seen: Mapping[str, SteeringEstimate], driver: Driver) -> SteeringEstimate | None:
    """The lane that ``driver`` follows, from the estimates with a lane."""
    if driver is Driver.SUREST:
        return max(seen.values(), key=lambda e: e.confidence, default=None)
    if driver is Driver.AVERAGE and seen:
        newest = max(seen.values(), key=lambda e: e.t_s)
        mean: dict[str, Any] = {name: fmean(getattr(e, name) for e in seen.values()) for name in LANE}
        return replace(newest, **mean)
    return seen.get(driver)
