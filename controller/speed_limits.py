"""Speed limit of the lane.

A bend of curvature κ is driven at v_c = √(a_y/|κ|) at most. To slow down to that with the deceleration b, the speed
may at a distance s before it be at most v_t with

    v_t² = v_c² + 2·b·(s - v·t_r)        t_r = τ_a + b/(2·j)

where v·t_r is the way before the brakes act: drive lag τ_a, and half of the time in which the demand grows to
b at its jerk j. The tightest such bound along the visible lane, or the cap if that is lower, is the target, and it
falls as braking with b does: v_t' = -b·v/v_t.

Where κ changes by c per metre, following it makes the lateral jerk |c|·v³, which is to be within j_y. That applies
where the visible lane, of length s, changes the lateral acceleration by more than Δ, |c|·s·v² > Δ, since every
estimate has some error in c.

The lane is unknown beyond the look-ahead. A bend that tightens there is assumed to tighten over the same
distance again, and to be braked for with the largest deceleration of driving on. A straight lane is assumed to
stay straight; the cap limits the speed there.
"""

import math
from typing import Annotated, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from trepid.bounds import at_least, at_most
from trepid.clothoid import Lane
from trepid.config import Settings
from trepid.types import Positive

_LOOKS = 8  # points along the visible lane in addition to the axle; as many beyond it
_STRAIGHT_1PM = 1e-9
_STEADY_1PM2 = 1e-9


class StopProfile(Settings):
    """One way to stop."""

    decel_mps2: Positive  # at most STRONGEST_MPS2 in the world of the car: controller.build
    jerk_mps3: Positive
    final_decel_mps2: Positive  # at the end of the stop

    def metres_and_seconds(self, speed_mps: float) -> tuple[float, float]:
        """Distance [m] and time [s] of a stop from a steady speed without drive lag.

        The demand rises with j to b, falls with √(2·j·v) to f, and stays there. At low speed b is not reached: the
        two ramps meet at the deceleration √(j·v).
        """
        b, j, f = self.decel_mps2, self.jerk_mps3, self.final_decel_mps2
        peak = min(b, math.sqrt(j * speed_mps))
        if peak > f:
            flat_s = speed_mps / peak - peak / j
            fall = ((peak - f) / j, -peak, j)
            phases = [(peak / j, 0.0, -j), (flat_s, -peak, 0.0), fall, (f / (2.0 * j), -f, 0.0)]
        else:
            rise_s = min(f / j, math.sqrt(2.0 * speed_mps / j))
            phases = [(rise_s, 0.0, -j), ((speed_mps - j * rise_s**2 / 2.0) / f, -f, 0.0)]
        metres = seconds = 0.0
        for span_s, accel_mps2, jerk_mps3 in phases:
            metres += span_s * (speed_mps + span_s * (accel_mps2 / 2.0 + span_s * jerk_mps3 / 6.0))
            speed_mps += span_s * (accel_mps2 + span_s * jerk_mps3 / 2.0)
            seconds += span_s
        return metres, seconds


class SpeedSettings(Settings):
    """``speed`` in ``config/controller.yaml``."""

    moved_fields: ClassVar = {"standstill_mps": "standstill_mps of vehicle.yaml"}

    lateral_accel_mps2: Positive  # a_y in bends
    lateral_jerk_mps3: Positive  # j_y where bends begin and end
    lateral_change_mps2: Positive  # Δ
    curve_decel_mps2: Positive  # b
    gain_1ps: Positive  # k
    max_accel_mps2: Positive
    max_decel_mps2: Positive  # of speed tracking; stops have their own
    jerk_mps3: Positive  # towards more drive
    brake_jerk_mps3: Positive  # towards more brake
    max_load_mps2: Annotated[float, Field(ge=0, le=3.0)]  # of a hill, counted in
    comfort: StopProfile
    emergency: StopProfile
    hold_decel_mps2: Positive  # brake demand that holds the car on the level
    critical_speed_share: Annotated[float, Field(gt=0, lt=1)]  # of an oversteering car's critical speed

    @model_validator(mode="after")
    def _fades_out_in_time(self) -> Self:
        if self.gain_1ps * self.max_accel_mps2 > self.brake_jerk_mps3:
            raise ValueError(
                "gain_1ps·max_accel_mps2 is above brake_jerk_mps3: the speed would overshoot its cap"
            )
        return self


class Target(NamedTuple):
    """The speed to drive now, and its rate of change; None: not known."""

    speed_mps: float
    accel_mps2: float | None


def target(
    lane: Lane, *, cap_mps: float, speed_mps: float, drive_lag_s: float, settings: SpeedSettings
) -> Target:
    """The highest speed that the cap and every bend of ``lane`` allow."""
    speed_mps = at_least(speed_mps, 0.0)
    comfort, hard = settings.curve_decel_mps2, settings.max_decel_mps2
    sight_m, rate_1pm2 = lane.lookahead_m, lane.curvature_rate_1pm2
    tightens = (lane.curvature_1pm + rate_1pm2 * sight_m) * rate_1pm2 > 0.0
    least, decel_mps2 = at_most(cap_mps * cap_mps, _smooth(lane, settings)), 0.0
    for n in range(2 * _LOOKS + 1 if tightens else _LOOKS + 1):
        ahead_m, brake_mps2 = sight_m * n / _LOOKS, comfort if n <= _LOOKS else hard
        react_m = speed_mps * (drive_lag_s + brake_mps2 / (2.0 * settings.brake_jerk_mps3))
        bend_1pm = at_least(abs(lane.curvature_1pm + rate_1pm2 * ahead_m), _STRAIGHT_1PM)
        left_m = at_least(ahead_m - react_m, 0.0)
        allowed = settings.lateral_accel_mps2 / bend_1pm + 2.0 * brake_mps2 * left_m
        if allowed < least:
            least, decel_mps2 = allowed, brake_mps2 if left_m > 0.0 else 0.0
    allowed_mps = math.sqrt(least)
    if decel_mps2 == 0.0:
        return Target(allowed_mps, None)
    return Target(allowed_mps, -decel_mps2 * min(1.0, speed_mps / allowed_mps))


def _smooth(lane: Lane, settings: SpeedSettings) -> float:
    """v² [m²/s²] up to which the lane begins or ends its bend within ``lateral_jerk_mps3``."""
    rate_1pm2 = at_least(abs(lane.curvature_rate_1pm2), _STEADY_1PM2)
    change_1pm = at_least(rate_1pm2 * lane.lookahead_m, _STRAIGHT_1PM)
    return at_least(
        (settings.lateral_jerk_mps3 / rate_1pm2) ** (2.0 / 3.0), settings.lateral_change_mps2 / change_1pm
    )
