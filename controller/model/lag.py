"""First-order lags: of steering, drive and brakes, and axles."""

import math

from trepid.bounds import within
from trepid.car.vehicle import Vehicle


def remaining_share(dt_s: float, lag_s: float) -> float:
    """Share e^(-dt/τ) of a difference that is left after ``dt_s``; 0 without lag."""
    return math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0


def wheel_after(wheel_rad: float, demand_rad: float, dt_s: float, vehicle: Vehicle) -> float:
    """Road-wheel angle [rad] after ``dt_s`` of a constant demand: δ' = (δ_cmd - δ)/τ, |δ'| ≤ rate limit."""
    share = 1.0 - remaining_share(dt_s, vehicle.steering_lag_s)
    return wheel_rad + within((demand_rad - wheel_rad) * share, vehicle.max_road_wheel_rate_radps * dt_s)
