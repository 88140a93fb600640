"""What a vehicle is: dimensions, steering and limits. Numbers live in ``config/vehicle.yaml``."""

from typing import Annotated

from pydantic import Field

from trepid.config import Settings

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class Vehicle(Settings):
    """A car-like vehicle; the reference point is the centre of the rear axle."""

    name: str
    wheelbase_m: Positive
    track_m: Positive  # between the outer edges of the wheels
    front_overhang_m: NonNegative  # front axle to bumper
    rear_overhang_m: NonNegative
    steering_ratio: Positive  # steering-wheel angle / road-wheel angle
    max_road_wheel_angle_rad: Annotated[float, Field(gt=0, lt=1.2)]
    max_road_wheel_rate_radps: Positive
    steering_delay_s: NonNegative  # dead time of the steering actuator
    steering_lag_s: NonNegative  # first-order time constant of the steering actuator
    understeer_gradient_rad_per_mps2: float  # K_us in δ = atan(L·κ) + K_us·κ·v²
    max_accel_mps2: Positive
    max_decel_mps2: Positive  # what the brakes can do
    accel_lag_s: NonNegative  # first-order time constant of drive and brakes
