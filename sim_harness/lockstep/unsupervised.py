"""Drivers without fear: a supervisor runs beside them, but the car follows what they choose, at cruise speed."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, Self

from supervisor.modes.modes import STARTING
from supervisor.rules.inference import CALM
from supervisor.supervisor import Supervisor
from trepid.messages import (
    Decision,
    ImageStatistics,
    LeadVehicle,
    Mode,
    RoadUsers,
    SteeringEstimate,
    Stop,
    VehicleState,
)

LANE = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2")
Estimates = Mapping[str, SteeringEstimate | None]


class FollowedLane(NamedTuple):
    """A followed lane."""

    t_s: float
    lookahead_m: float
    lane: dict[str, float | None]  # the fields LANE

    @classmethod
    def of(cls, message: SteeringEstimate | Decision, t_s: float) -> Self:
        """The lane of ``message``, valid at ``t_s``."""
        return cls(t_s, message.lookahead_m, {name: getattr(message, name) for name in LANE})

    @classmethod
    def arc(cls, estimate: SteeringEstimate, *, wheelbase_m: float) -> Self | None:
        """The arc of a road-wheel angle from the rear axle on, κ = tan(δ)/L; None without an angle."""
        if estimate.road_wheel_angle_rad is None:
            return None
        curvature_1pm = math.tan(estimate.road_wheel_angle_rad) / wheelbase_m
        lane: dict[str, float | None] = dict(zip(LANE, (0.0, 0.0, curvature_1pm, 0.0), strict=True))
        return cls(estimate.t_s, estimate.lookahead_m, lane)


Choice = Callable[[Decision, Estimates], FollowedLane | None]
"""The lane to follow from now on, from the decision of the supervisor and the estimates; None without one."""
Report = Callable[[VehicleState | None, float], VehicleState | None]
"""The vehicle state that the supervisor gets, from the true report of the car and the time."""


class UnsupervisedDriver:
    """Follows the lane that ``choice`` returns at cruise speed; the fear of a supervisor has no effect.

    Without a lane it follows the last one and does not stop.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        name: str,
        choice: Choice,
        *,
        cruise_speed_mps: float,
        report: Report = lambda state, _: state,
    ) -> None:
        self._supervisor, self._name, self._choice, self._report = supervisor, name, choice, report
        self._cruise_speed_mps = cruise_speed_mps
        self._followed: FollowedLane | None = None

    def step(
        self,
        estimates: Estimates,
        statistics: ImageStatistics | None,
        lead: LeadVehicle | None,
        state: VehicleState | None,
        *,
        now_s: float,
        road_users: RoadUsers | None = None,
    ) -> Decision:
        """The decision of the driver, with the fear of the supervisor."""
        reported = self._report(state, now_s)
        supervised = self._supervisor.step(
            estimates, statistics, lead, reported, now_s=now_s, road_users=road_users
        )
        followed = self._followed = self._choice(supervised, estimates) or self._followed
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
            path_source=self._name,
            cause=CALM
            if supervised.cause == STARTING
            else supervised.cause,  # this driver has no start condition
            speed_factor=1.0,
            speed_cap_mps=self._cruise_speed_mps,
            **lane,
        )
