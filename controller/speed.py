"""Longitudinal control: how fast the lane allows to drive, and a jerk-limited acceleration towards it.

A bend of curvature κ is driven at v_c = √(a_y/|κ|) at most, so at a distance d before it the speed may be at most
√(v_c² + 2·b·d) when braking with b. The tightest such bound along the visible lane, or the cap if that is lower,
is the target v_t. The demand is a = k·(v_t - v) + dv_t/dt, bounded and limited in jerk.

With drive lag τ_a the loop s² τ_a + s + k has damping 1/(2√(k·τ_a)); above 1 the speed never overshoots its cap.
The demand must also be able to fade out as fast as k·a asks for: k·max_accel ≤ brake_jerk. Both are checked on
loading.

A stop goes to its deceleration at its jerk, falls off with √(2·j·v) so that the car does not lurch at the end, and
holds the brake at standstill.
"""

import math
from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator

from controller.lane import Lane
from trepid.bounds import at_least, at_most
from trepid.config import Settings
from trepid.messages import Stop
from trepid.vehicle import Positive

_LOOKS = 8  # places along the visible lane, besides the axle
_STRAIGHT_1PM = 1e-9


class StopProfile(Settings):
    """One way to stop."""

    decel_mps2: Annotated[float, Field(gt=0, le=4.0)]  # UN R157 5.3: a minimal-risk manoeuvre stays below 4
    jerk_mps3: Positive
    final_decel_mps2: Positive  # the least in the last moments


class SpeedSettings(Settings):
    """``speed`` in ``config/controller.yaml``."""

    lateral_accel_mps2: Positive  # a_y in bends
    curve_decel_mps2: Positive  # b
    gain_1ps: Positive  # k
    max_accel_mps2: Positive
    max_decel_mps2: Positive  # of speed tracking; stops have their own
    jerk_mps3: Positive  # towards more drive
    brake_jerk_mps3: Positive  # towards more brake
    comfort: StopProfile
    emergency: StopProfile
    standstill_mps: Positive  # below this the car stands
    hold_decel_mps2: Positive  # brake demand that holds the car
    critical_speed_share: Annotated[float, Field(gt=0, lt=1)]  # of an oversteering car's critical speed

    @model_validator(mode="after")
    def _fades_out_in_time(self) -> Self:
        if self.gain_1ps * self.max_accel_mps2 > self.brake_jerk_mps3:
            raise ValueError(
                "gain_1ps·max_accel_mps2 is above brake_jerk_mps3: the speed would overshoot its cap"
            )
        return self


class Target(NamedTuple):
    """The speed to drive now, and how fast it changes."""

    speed_mps: float
    accel_mps2: float


def target(lane: Lane, *, cap_mps: float, speed_mps: float, settings: SpeedSettings) -> Target:
    """The highest speed that the cap and every bend of ``lane`` as far as it is seen allow."""
    lateral_mps2, decel_mps2 = settings.lateral_accel_mps2, settings.curve_decel_mps2
    least, bound_m = cap_mps * cap_mps, None
    for n in range(_LOOKS + 1):
        ahead_m = lane.lookahead_m * n / _LOOKS
        bend_1pm = abs(lane.curvature_1pm + lane.curvature_rate_1pm2 * ahead_m)
        allowed = lateral_mps2 / at_least(bend_1pm, _STRAIGHT_1PM) + 2.0 * decel_mps2 * ahead_m
        if allowed < least:
            least, bound_m = allowed, ahead_m
    if bound_m is None:
        return Target(cap_mps, 0.0)
    allowed_mps = math.sqrt(least)
    return Target(allowed_mps, -decel_mps2 * min(1.0, max(0.0, speed_mps) / allowed_mps) if bound_m else 0.0)


class SpeedControl:
    """Turns targets and stops into acceleration demands; remembers only the last demand. Starts braked."""

    def __init__(self, settings: SpeedSettings) -> None:
        self._settings = settings
        self.accel_mps2 = -settings.hold_decel_mps2

    def track(self, goal: Target, *, speed_mps: float, dt_s: float) -> float:
        """Acceleration [m/s²] towards ``goal``; holds the brake where the goal is to stand."""
        settings = self._settings
        if goal.speed_mps <= settings.standstill_mps:
            return self.stop(Stop.COMFORT, speed_mps=speed_mps, dt_s=dt_s)
        wanted = settings.gain_1ps * (goal.speed_mps - speed_mps) + goal.accel_mps2
        wanted = at_least(at_most(wanted, settings.max_accel_mps2), -settings.max_decel_mps2)
        return self._towards(wanted, settings.jerk_mps3 * dt_s, settings.brake_jerk_mps3 * dt_s)

    def stop(self, how: Stop, *, speed_mps: float | None, dt_s: float) -> float:
        """Acceleration [m/s²], never positive, that stops the car and holds it.

        ``speed_mps`` None: the speed is not known; brakes without end.
        """
        settings = self._settings
        profile = settings.emergency if how is Stop.EMERGENCY else settings.comfort
        decel_mps2 = profile.decel_mps2
        if speed_mps is not None:
            soft = math.sqrt(2.0 * profile.jerk_mps3 * max(0.0, speed_mps))
            decel_mps2 = min(decel_mps2, max(profile.final_decel_mps2, soft))
            if speed_mps <= settings.standstill_mps:
                decel_mps2 = settings.hold_decel_mps2
        self.accel_mps2 = min(0.0, self.accel_mps2)  # the drive lets go at once
        return self._towards(-decel_mps2, profile.jerk_mps3 * dt_s, profile.jerk_mps3 * dt_s)

    def release(self) -> float:
        """No demand: a driver drives, and takes over or hands over without a jerk."""
        self.accel_mps2 = 0.0
        return self.accel_mps2

    def _towards(self, wanted_mps2: float, rise_mps2: float, fall_mps2: float) -> float:
        """Move the demand towards ``wanted_mps2``, up or down at most so far."""
        self.accel_mps2 += at_least(at_most(wanted_mps2 - self.accel_mps2, rise_mps2), -fall_mps2)
        return self.accel_mps2
