"""Drivers without a supervisor, for comparison: one estimator, the plain average, or the surest."""

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from statistics import fmean
from typing import Any

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
    """Which lane is driven."""

    CV = "cv"
    CNN = "cnn"
    AVERAGE = "average"
    SUREST = "surest"


class Watched:
    """Drives what ``driver`` says, fearless; the supervisor watches, and its fear is what the decision carries.

    Where nothing is seen the last lane is driven on: a driver without a supervisor has nobody to say when to stop.
    """

    def __init__(self, supervisor: Supervisor, driver: Driver, *, cruise_speed_mps: float) -> None:
        self._supervisor, self._driver, self._cruise_speed_mps = supervisor, driver, cruise_speed_mps
        self._lane: SteeringEstimate | None = None

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
        felt = self._supervisor.step(estimates, statistics, lead, state, now_s=now_s)
        seen = {name: e for name, e in estimates.items() if e is not None and e.lateral_offset_m is not None}
        self._lane = chosen(seen, self._driver) or self._lane
        lane = self._lane
        path: dict[str, Any] = {name: getattr(lane, name) if lane else None for name in LANE}
        return replace(
            felt,
            mode=Mode.KEEP if lane else Mode.STOP,
            stop=Stop.NONE if lane else Stop.COMFORT,
            path_t_s=lane.t_s if lane else None,
            lookahead_m=lane.lookahead_m if lane else felt.lookahead_m,
            path_source=str(self._driver) if lane else "none",
            speed_factor=1.0 if lane else 0.0,
            speed_cap_mps=self._cruise_speed_mps if lane else 0.0,
            **path,
        )


def chosen(seen: Mapping[str, SteeringEstimate], driver: Driver) -> SteeringEstimate | None:
    """The lane that ``driver`` drives, of estimates that have one."""
    if driver is Driver.SUREST:
        return max(seen.values(), key=lambda e: e.confidence, default=None)
    if driver is Driver.AVERAGE and seen:
        newest = max(seen.values(), key=lambda e: e.t_s)
        mean: dict[str, Any] = {name: fmean(getattr(e, name) for e in seen.values()) for name in LANE}
        return replace(newest, **mean)
    return seen.get(driver)
