"""From commands to an RC car: acceleration to speed, speed to throttle pulse, road-wheel angle to steering pulse.

The maps to pulses are piecewise linear, hold for the wheels and not for the servo horn, and stay within hard ends.

An RC car takes no acceleration, its speed controller takes a speed.

The demand is the integral v_d += a·dt, from 0 up to the fastest speed of the throttle table. With a sensor it is at
most ``LEAD_MPS`` above the measured speed, so that it does not wind up on a hill or with a flat battery; after
neutral an acceleration starts it at most ``LEAD_MPS`` below. Nothing else raises it: a car that is faster than its
table would be driven faster by a demand that follows its speed. The modelled speed follows the demand with a lag of
first order: v += (v_d - v)·(1 - exp(-dt/T)).
"""

import errno
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from trepid.car.vehicle import Vehicle
from trepid.config import Settings, wrong_at

Pulse = Annotated[float, Field(ge=400, le=2600)]  # [µs] what servos are made for, and a margin
Angle = Annotated[float, Field(gt=0, lt=1.2)]
Channel = Annotated[int, Field(ge=0, le=23)]
Speed = Annotated[float, Field(ge=0, le=40)]


class Pulses(Settings):
    """What both channels have."""

    channel: Channel
    least_us: Pulse  # hard ends: no pulse beyond them leaves this computer
    most_us: Pulse

    def within(self, pulse_us: float) -> float:
        """``pulse_us`` within the hard ends."""
        return max(self.least_us, min(self.most_us, pulse_us))

    def _must_contain(self, name: str, pulse_us: float) -> None:
        if not self.least_us <= pulse_us <= self.most_us:
            raise wrong_at(
                (name,),
                f"{pulse_us:g} µs is outside of least_us..most_us, {self.least_us:g}..{self.most_us:g}",
            )


class Steering(Pulses):
    """Centre and both ends; the sign is that of ``left_us - right_us``."""

    centre_us: Pulse
    left_us: Pulse
    right_us: Pulse
    left_rad: Angle  # road-wheel angle at left_us, as a magnitude
    right_rad: Angle  # likewise at right_us

    @model_validator(mode="after")
    def _monotone(self) -> Self:
        for name in ("centre_us", "left_us", "right_us"):
            self._must_contain(name, getattr(self, name))
        if (self.left_us - self.centre_us) * (self.centre_us - self.right_us) <= 0.0:
            raise wrong_at(("centre_us",), "must lie between left_us and right_us")
        return self

    def pulse_us(self, angle_rad: float) -> float:
        """Pulse [µs] for the road-wheel angle, + = left; at most the ends."""
        left, right = (self.left_rad, self.left_us), (-self.right_rad, self.right_us)
        return self.within(interpolate((right, (0.0, self.centre_us), left), angle_rad))

    def angle_rad(self, pulse_us: float) -> float:
        """Road-wheel angle [rad] at a pulse: the inverse of :meth:`pulse_us`."""
        points = [(self.right_us, -self.right_rad), (self.centre_us, 0.0), (self.left_us, self.left_rad)]
        return interpolate(sorted(points), pulse_us)

    def reachable_angle_rad(self, angle_rad: float) -> float:
        """The part of ``angle_rad`` within both ends."""
        return max(-self.right_rad, min(self.left_rad, angle_rad))


class Throttle(Pulses):
    """Neutral, and the pulse of each measured speed. The car is never driven in reverse."""

    neutral_us: Pulse
    speeds: Annotated[tuple[tuple[Speed, Pulse], ...], Field(min_length=1)]
    """(speed [m/s], pulse [µs]), slowest first. The speed 0 may stand for the end of the dead band."""
    brake_us: Pulse | None = None

    @model_validator(mode="after")
    def _monotone(self) -> Self:
        self._must_contain("neutral_us", self.neutral_us)
        if self.brake_us is not None:
            self._must_contain("brake_us", self.brake_us)
        sign = 1.0 if self.speeds[-1][1] > self.neutral_us else -1.0
        before = (-1.0, self.neutral_us)
        for index, (speed_mps, pulse_us) in enumerate(self.speeds):
            if not self.least_us <= pulse_us <= self.most_us:
                raise wrong_at(("speeds", index), f"{pulse_us:g} µs is outside of least_us..most_us")
            if speed_mps <= before[0] or sign * (pulse_us - before[1]) <= 0.0:
                raise wrong_at(
                    ("speeds", index), "speeds must rise, and their pulses must move away from neutral_us"
                )
            before = speed_mps, pulse_us
        if self.brake_us is not None and sign * (self.brake_us - self.neutral_us) >= 0.0:
            raise wrong_at(
                ("brake_us",), "drives the car: must lie on the other side of neutral_us than speeds"
            )
        if self.speeds[-1][0] <= 0.0:
            raise wrong_at(("speeds",), "needs at least one speed above 0")
        return self

    @property
    def most_mps(self) -> float:
        """The fastest speed of the table."""
        return self.speeds[-1][0]

    def pulse_us(self, speed_mps: float) -> float:
        """Pulse [µs] for a speed: exactly neutral for 0, at most that of the fastest speed."""
        if speed_mps <= 0.0:
            return self.neutral_us
        return self.within(interpolate(self._points(), speed_mps))

    def speed_mps(self, pulse_us: float) -> float:
        """Speed [m/s] that the car reaches at a pulse; 0 on the other side of neutral."""
        points = sorted((pulse, speed) for speed, pulse in self._points())
        return interpolate(points, pulse_us)

    def _points(self) -> Sequence[tuple[float, float]]:
        first = () if self.speeds[0][0] == 0.0 else ((0.0, self.neutral_us),)
        return (*first, *self.speeds)


def interpolate(points: Sequence[tuple[float, float]], x: float) -> float:
    """Linear interpolation between ``points`` in rising order of x; constant outside."""
    if x <= points[0][0]:
        return points[0][1]
    for (x0, y0), (x1, y1) in pairwise(points):
        if x <= x1:
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return points[-1][1]


LEAD_MPS = 0.5
REST_LAGS = 5.0  # e⁻⁵: a car that rolls at 3 m/s at the start has 2 cm/s left
LONGEST_S = 0.05  # a pause of this process counts as this long
CREEP_MPS = 0.02  # a slower demand of a braking car is standstill


class SpeedIntegrator:
    """Call ``step`` with every command."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._then_s: float | None = None
        self.demand_mps = 0.0
        """The speed for the throttle table."""
        self.modelled_mps = 0.0
        """The speed that the car should have; it stands until the first command."""

    def step(self, accel_mps2: float, most_mps: float, measured_mps: float | None, *, now_s: float) -> float:
        """The speed demand at ``now_s`` [m/s]; ``measured_mps`` is None without a sensor."""
        dt_s = 0.0 if self._then_s is None else max(0.0, min(now_s - self._then_s, LONGEST_S))
        self._then_s = now_s
        part = 1.0 if self._lag_s <= 0.0 else 1.0 - math.exp(-dt_s / self._lag_s)
        self.modelled_mps += part * (self.demand_mps - self.modelled_mps)
        demand_mps = self.demand_mps
        if measured_mps is not None and demand_mps == 0.0 and accel_mps2 > 0.0:
            demand_mps = max(0.0, measured_mps - LEAD_MPS)
        demand_mps += accel_mps2 * dt_s
        if measured_mps is not None:
            demand_mps = min(measured_mps + LEAD_MPS, demand_mps)
        if accel_mps2 <= 0.0 and demand_mps < CREEP_MPS:
            demand_mps = 0.0
        self.demand_mps = max(0.0, min(most_mps, demand_mps))
        if self.demand_mps == 0.0 and self.modelled_mps < CREEP_MPS:
            self.modelled_mps = 0.0
        return self.demand_mps

    def rest(self, for_s: float, *, now_s: float) -> None:
        """The throttle has been neutral for ``for_s`` up to ``now_s``, without a command."""
        self._then_s = now_s
        self.demand_mps = 0.0
        self.modelled_mps *= math.exp(-for_s / self._lag_s) if self._lag_s > 0.0 else 0.0


class Silence:
    """The time without pulses, after which guard or board have taken the drive away."""

    def __init__(self, after_s: float, motion: SpeedIntegrator) -> None:
        self._after_s, self._motion = after_s, motion
        self._written_s = math.inf  # time of the last pulses; inf: none so far

    def check(self, *, now_s: float) -> None:
        """Raise OSError, once, when no pulses were sent for so long; the motion has then been at rest."""
        silent_s = now_s - self._written_s
        if silent_s > self._after_s:
            self._written_s = now_s
            self._motion.rest(silent_s - self._after_s, now_s=now_s)
            raise OSError(errno.ETIMEDOUT, f"no pulses for {silent_s:.2f} s: the throttle went to neutral")

    def end(self, *, now_s: float) -> None:
        """Pulses have been sent."""
        self._written_s = now_s


class YawModel:
    """The yaw rate of the bicycle, ψ' = v·tan δ/(L + K_us·v²), with δ behind the pulse by delay and lag."""

    def __init__(self, vehicle: Vehicle, angle_rad: float | None, *, now_s: float) -> None:
        """``angle_rad``: of the wheels now; None: not known."""
        self._vehicle, self._turned_rad, self._then_s = vehicle, angle_rad or 0.0, now_s

    def step(self, angle_rad: float | None, speed_mps: float | None, *, now_s: float) -> float | None:
        """The yaw rate [rad/s] at ``now_s``, with the angle of the last pulse; None where one is not known."""
        car = self._vehicle
        late_s = car.steering_delay_s + car.steering_lag_s
        dt_s, self._then_s = max(0.0, now_s - self._then_s), now_s
        part = 1.0 - math.exp(-dt_s / late_s) if late_s > 0.0 else 1.0
        if angle_rad is None:
            return None
        self._turned_rad += part * (angle_rad - self._turned_rad)
        if speed_mps is None:
            return None
        length_m = car.wheelbase_m + car.understeer_gradient_rad_per_mps2 * speed_mps**2
        return speed_mps * math.tan(self._turned_rad) / length_m
