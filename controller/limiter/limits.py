"""Limits of the limiter, with values and sources in ``config/limiter.yaml``, and intervals that are never empty."""

import math
from typing import Annotated, ClassVar

from pydantic import Field

from trepid.config import Settings
from trepid.types import Positive, PositiveShare

Deceleration = Annotated[float, Field(gt=0, le=4.0)]  # UN R157 5.3


class OverrideLimits(Settings):
    """Detection of the driver, and the hand-over."""

    torque_nm: Positive  # at the steering wheel
    angle_rad: Positive  # the road wheel is this far from all recent demands ...
    angle_after_s: Positive  # ... for this long
    lateness: Annotated[
        float, Field(ge=1)
    ]  # longest delay of the steering, as a multiple of the vehicle file's
    still_rad: Positive  # a larger motion of the wheel is one by the driver
    release_s: Positive  # without action of the driver the car is handed back after this time
    fade_mps3: Positive  # rate at which drive and brakes fade
    fade_in_s: Positive  # after the hand-back the wheel's rate and the jerk grow up to their limits


class SaturationLimits(Settings):
    """Detection of a steering demand that is cut for longer."""

    cut_mps2: Positive  # of lateral acceleration
    after_s: Positive
    from_mps: Positive


class Limits(Settings):
    """``config/limiter.yaml``."""

    moved_fields: ClassVar = {"standstill_mps": "standstill_mps of vehicle.yaml"}

    lateral_accel_mps2: Positive
    lateral_jerk_mps3: Positive
    lateral_accel_share: PositiveShare  # share of the limit for demands
    lateral_jerk_share: PositiveShare
    yaw_share: (
        PositiveShare  # largest share of the limit of lateral acceleration that the yaw rate reduces it by
    )
    max_accel_mps2: Positive
    max_decel_mps2: Deceleration
    comfort_decel_mps2: Deceleration
    stop_decel_mps2: Deceleration
    command_late_s: Positive
    command_timeout_s: Positive
    command_rate_hz: Positive
    state_timeout_s: Positive
    frame_timeout_s: Positive
    early_s: Positive
    max_step_s: Positive
    max_speed_mps: Positive
    max_angle_rad: Annotated[float, Field(gt=0, lt=math.pi / 2)]
    override: OverrideLimits
    saturation: SaturationLimits


Interval = tuple[float, float]


def clip(value: float, interval: Interval) -> float:
    """The point of ``interval`` nearest to ``value``."""
    low, high = interval
    return max(low, min(high, value))


def narrow(outer: Interval, inner: Interval) -> Interval:
    """The part of ``outer`` in ``inner``, or the point of ``outer`` nearest to it: never empty."""
    return clip(inner[0], outer), clip(inner[1], outer)


def inside(value: float, interval: Interval) -> bool:
    """Whether ``value`` lies in ``interval``, its ends included."""
    low, high = interval
    return low <= value <= high
