"""What the limiter allows; numbers and sources in ``config/limiter.yaml``."""

import math
from typing import Annotated

from pydantic import Field

from trepid.config import Settings
from trepid.types import Positive, PositiveShare

Deceleration = Annotated[float, Field(gt=0, le=4.0)]  # UN R157 5.3


class OverrideLimits(Settings):
    """When the driver has the car, and how it is handed over."""

    torque_nm: Positive  # at the steering wheel
    angle_rad: Positive  # the road wheel is this far from all that was asked of it lately ...
    angle_after_s: Positive  # ... for this long
    lateness: Annotated[
        float, Field(ge=1)
    ]  # the steering may be this many times as late as the vehicle file says
    still_rad: Positive  # a wheel that moves by more is being turned
    release_s: Positive  # without a sign of the driver: the car is handed back
    fade_mps3: Positive  # drive and brakes are let go this quickly
    fade_in_s: Positive  # after the hand-back the wheel's rate and the jerk grow up to their limits


class SaturationLimits(Settings):
    """When the steering demand is being cut for more than a moment."""

    cut_mps2: Positive  # of lateral acceleration
    after_s: Positive
    from_mps: Positive


class Limits(Settings):
    """``config/limiter.yaml``."""

    lateral_accel_mps2: Positive
    lateral_jerk_mps3: Positive
    lateral_accel_share: PositiveShare  # of the limit, that a demand may take
    lateral_jerk_share: PositiveShare
    yaw_share: PositiveShare  # of the limit of lateral acceleration that a yaw rate may take off it
    max_accel_mps2: Positive
    max_decel_mps2: Deceleration
    comfort_decel_mps2: Deceleration
    stop_decel_mps2: Deceleration
    command_timeout_s: Positive
    command_rate_hz: Positive
    state_timeout_s: Positive
    frame_timeout_s: Positive
    early_s: Positive
    max_step_s: Positive
    max_speed_mps: Positive
    max_angle_rad: Annotated[float, Field(gt=0, lt=math.pi / 2)]
    standstill_mps: Positive
    override: OverrideLimits
    saturation: SaturationLimits
