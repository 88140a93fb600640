"""The calibration of an RC car: road-wheel angle to steering pulse, speed to throttle pulse.

Both are piecewise linear, hold for the wheels and not for the servo horn, and stay within hard ends.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

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
        return self.within(_between((right, (0.0, self.centre_us), left), angle_rad))

    def angle_rad(self, pulse_us: float) -> float:
        """Road-wheel angle [rad] at a pulse: the inverse of :meth:`pulse_us`."""
        points = [(self.right_us, -self.right_rad), (self.centre_us, 0.0), (self.left_us, self.left_rad)]
        return _between(sorted(points), pulse_us)

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
        return self.within(_between(self._points(), speed_mps))

    def speed_mps(self, pulse_us: float) -> float:
        """Speed [m/s] that the car reaches at a pulse; 0 on the other side of neutral."""
        points = sorted((pulse, speed) for speed, pulse in self._points())
        return _between(points, pulse_us)

    def _points(self) -> Sequence[tuple[float, float]]:
        first = () if self.speeds[0][0] == 0.0 else ((0.0, self.neutral_us),)
        return (*first, *self.speeds)


def _between(points: Sequence[tuple[float, float]], x: float) -> float:
    """Linear interpolation between ``points`` in rising order of x; constant outside."""
    if x <= points[0][0]:
        return points[0][1]
    for (x0, y0), (x1, y1) in pairwise(points):
        if x <= x1:
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return points[-1][1]
