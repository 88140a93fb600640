"""First-order lags, and the response of the tyres to the wheel angle: drift of the rear axle, lag to the path.

Tyres carry an axle round a bend only at a slip angle. That of the rear axle turns the car's nose into the bend, so
the rear axle moves along its *course*, heading + β, and not along its heading. For an axle of mass m and cornering
stiffness C the slip per lateral acceleration is its slip gradient m/C [rad/(m/s²)]: R at the rear, F = R + K_us in
front. With the yaw inertia m·l_f·l_r, which cars have within 10 %, each axle is a mass of its own:

    R·v·(β' + r) = -β                                   β drift [rad], r = v·κ_y yaw rate, ' = d/dt
    F·v·(φ' + r) = δ - φ        φ = atan(β + L·κ_y)     φ direction in which the front axle moves

In the steady turn β = -R·v²·κ. For small angles the path curvature of the rear axle is, exactly,

    κ = δ / (L·(1 + F·v·s)(1 + R·v·s) + K_us·v²)        s = d/dt

which lags a ramp of δ by T = L·(F + R)·v/(L + K_us·v²). R = 0: the tyres are not known, no drift, no lag.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.3 and 3.3; the axles as masses of their own: Milliken and
Milliken, Race Car Vehicle Dynamics (1995), section 5.14 (dynamic index 1).
"""

import math
from typing import NamedTuple

from controller.model.bicycle import curvature_from_angle
from trepid.bounds import at_least, within
from trepid.car.vehicle import Vehicle


def remaining_share(dt_s: float, lag_s: float) -> float:
    """Share e^(-dt/τ) of a difference that is left after ``dt_s``; 0 without lag."""
    return math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0


def wheel_after(wheel_rad: float, demand_rad: float, dt_s: float, vehicle: Vehicle) -> float:
    """Road-wheel angle [rad] after ``dt_s`` of a constant demand: δ' = (δ_cmd - δ)/τ, |δ'| ≤ rate limit."""
    share = 1.0 - remaining_share(dt_s, vehicle.steering_lag_s)
    return wheel_rad + within((demand_rad - wheel_rad) * share, vehicle.max_road_wheel_rate_radps * dt_s)


_MAX_DIRECTION_RAD = 1.4  # of the front axle, below 90°
_CRAWL_MPS = 0.5  # below it the tyres follow without lag


class Turning(NamedTuple):
    """Yaw and drift of the car."""

    yaw_1pm: float  # κ_y, yaw per metre
    drift_rad: float  # β, course minus heading of the rear axle


class Tyres:
    """The axles of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._wheelbase_m = vehicle.wheelbase_m
        self._gradient = vehicle.understeer_gradient_rad_per_mps2
        self._rear = vehicle.rear_slip_gradient_rad_per_mps2
        self._front = at_least(self._rear + self._gradient, 0.0)

    def lag_s(self, speed_mps: float) -> float:
        """T [s], by which the path lags a ramp of the wheel angle; oversteer does not count."""
        if self._rear == 0.0:
            return 0.0
        held_m = self._wheelbase_m + at_least(self._gradient, 0.0) * speed_mps * speed_mps
        return self._wheelbase_m * (self._front + self._rear) * abs(speed_mps) / held_m

    def drift_after(self, drift_rad: float, yaw_rate_radps: float, speed_mps: float, dt_s: float) -> float:
        """β [rad] ``dt_s`` later at constant yaw rate."""
        if self._rear == 0.0:
            return 0.0
        settled_rad = -self._rear * speed_mps * yaw_rate_radps
        if abs(speed_mps) < _CRAWL_MPS:
            return settled_rad
        return settled_rad + (drift_rad - settled_rad) * remaining_share(dt_s, self._rear * abs(speed_mps))

    def turning(self, yaw_rate_radps: float, drift_rad: float, wheel_rad: float, speed_mps: float) -> Turning:
        """The measured turn; that of the wheel angle where the tyres follow without lag."""
        if self._at_once(speed_mps):
            return Turning(self.steady_1pm(wheel_rad, speed_mps), drift_rad)
        return Turning(yaw_rate_radps / speed_mps, drift_rad)

    def after(
        self, turning: Turning, wheel_before_rad: float, wheel_rad: float, speed_mps: float, dt_s: float
    ) -> Turning:
        """``turning`` after ``dt_s`` in which the wheel moves; one axle settles exponentially after the other."""
        yaw_1pm, drift_rad = turning
        if self._at_once(speed_mps):
            yaw_1pm = self.steady_1pm(wheel_rad, speed_mps)
            return Turning(yaw_1pm, self.drift_after(drift_rad, yaw_1pm * speed_mps, speed_mps, dt_s))
        wheel_rad = 0.5 * (wheel_before_rad + wheel_rad)
        towards_rad = within(wheel_rad + drift_rad * self._front / self._rear, _MAX_DIRECTION_RAD)
        settled_1pm = (math.tan(towards_rad) - drift_rad) / self._wheelbase_m
        left = remaining_share(dt_s, self._front * abs(speed_mps))
        end_1pm = settled_1pm + (yaw_1pm - settled_1pm) * left
        mean_radps = 0.5 * (yaw_1pm + end_1pm) * speed_mps
        return Turning(end_1pm, self.drift_after(drift_rad, mean_radps, speed_mps, dt_s))

    def path_1pm(self, turning: Turning, speed_mps: float) -> float:
        """Curvature [1/m] of the rear axle's path: κ_y + β'/v = -β/(R·v²)."""
        if self._at_once(speed_mps):
            return turning.yaw_1pm
        return -turning.drift_rad / (self._rear * speed_mps * speed_mps)

    def _at_once(self, speed_mps: float) -> bool:
        return self._rear == 0.0 or abs(speed_mps) < _CRAWL_MPS

    def steady_1pm(self, wheel_rad: float, speed_mps: float) -> float:
        """Curvature of the steady turn; zero where there is none (oversteer beyond its limits)."""
        curvature_1pm = curvature_from_angle(wheel_rad, speed_mps=speed_mps, vehicle=self._vehicle)
        return curvature_1pm if curvature_1pm is not None else 0.0
