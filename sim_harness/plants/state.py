"""Where a simulated vehicle is and how it moves."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """Where the vehicle is, how it moves, and the steering demands on their way to the wheels."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0  # not wrapped: grows by 2π per left-hand lap
    speed_mps: float = 0.0  # never negative
    accel_mps2: float = 0.0
    road_wheel_angle_rad: float = 0.0
    acting_demand_rad: float = 0.0  # the demand that the steering follows now
    pending: tuple[tuple[float, float], ...] = ()  # (due in [s], demand [rad]), earliest first
