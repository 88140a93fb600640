"""Steady-state bicycle model: road-wheel angle against path curvature, with understeer and road bank.

    δ = atan(L·κ) + K·(κ·v² + g·φ)

δ  road-wheel angle [rad], left positive
κ  path curvature at the rear axle [1/m], left positive
v  speed [m/s]; only v² enters, so reverse needs the same angle for the same path
K  understeer gradient K_us [rad/(m/s²)]: K > 0 understeers, K = 0 is kinematic, K < 0 oversteers
φ  bank of the road [rad], left side up positive (ISO 8855 roll); the tyres also carry the part g·φ of the weight

The bank is small-angle (sin φ ≈ φ), as in opendbc's VehicleModel, of which the term in K is the exact equal.

For K < 0 the slope dδ/dκ = L/(1 + L²κ²) + K·v² is positive only below the critical speed √(-L/K) and only up to
a largest curvature. Beyond either there is no stable steady turn, and the inverse returns None.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.2 and 3.3; Gillespie, Fundamentals of Vehicle Dynamics
(1992), chapter 6.
"""

import math

from trepid.car.vehicle import Vehicle, road_wheel_angle

GRAVITY_MPS2 = 9.80665
_MAX_NEWTON_STEPS = 60  # six suffice but for oversteer close to its tightest turn


def angle_from_curvature(
    curvature_1pm: float, *, speed_mps: float, vehicle: Vehicle, roll_rad: float = 0.0
) -> float:
    """Road-wheel angle δ [rad] that holds ``curvature_1pm``; not limited to the range of the vehicle."""
    tyres_rad = understeer_angle(curvature_1pm, speed_mps=speed_mps, vehicle=vehicle, roll_rad=roll_rad)
    return road_wheel_angle(curvature_1pm, wheelbase_m=vehicle.wheelbase_m) + tyres_rad


def understeer_angle(
    curvature_1pm: float, *, speed_mps: float, vehicle: Vehicle, roll_rad: float = 0.0
) -> float:
    """K·(κ·v² + g·φ) [rad]: the part of lateral acceleration and bank in the road-wheel angle."""
    side_force_mps2 = curvature_1pm * speed_mps * speed_mps + GRAVITY_MPS2 * roll_rad
    return vehicle.understeer_gradient_rad_per_mps2 * side_force_mps2


def curvature_from_angle(
    angle_rad: float, *, speed_mps: float, vehicle: Vehicle, roll_rad: float = 0.0
) -> float | None:
    """Path curvature κ [1/m] of the stable steady turn at ``angle_rad``; None where there is none.

    With u = L·κ, c = K·v²/L and d = |δ - K·g·φ| solves atan(u) + c·u = d. The left side is concave for u > 0, so
    Newton from u = 0 climbs to the root from below and never passes it.

    None for K < 0 at or above the critical speed or beyond the tightest steady turn, and for a |δ| of 90° and
    more where K is zero.
    """
    gradient, wheelbase_m = vehicle.understeer_gradient_rad_per_mps2, vehicle.wheelbase_m
    tyre_rad = angle_rad - gradient * GRAVITY_MPS2 * roll_rad
    compliance, target = gradient * speed_mps * speed_mps / wheelbase_m, abs(tyre_rad)
    if compliance <= -1.0:
        return None
    u = target / (1.0 + compliance)  # Newton's first step
    for _ in range(_MAX_NEWTON_STEPS):
        slope = 1.0 / (1.0 + u * u) + compliance
        if slope <= 0.0:
            return None
        step = (target - math.atan(u) - compliance * u) / slope
        u += step
        if step <= 1e-15 * u < math.inf:  # a step back is rounding: converged
            return math.copysign(u / wheelbase_m, tyre_rad)
    return None


def transposed_angle(
    angle_rad: float, *, from_speed_mps: float, to_speed_mps: float, vehicle: Vehicle
) -> float | None:
    """Angle that drives at ``to_speed_mps`` the path that ``angle_rad`` drives at ``from_speed_mps``.

    For small angles δ(v) = δ(v₀)·(L + K·v²)/(L + K·v₀²), the Deep Steer paper's section 3. None where there is no
    steady turn to transpose.
    """
    curvature_1pm = curvature_from_angle(angle_rad, speed_mps=from_speed_mps, vehicle=vehicle)
    if curvature_1pm is None:
        return None
    return angle_from_curvature(curvature_1pm, speed_mps=to_speed_mps, vehicle=vehicle)


def critical_speed(vehicle: Vehicle) -> float:
    """√(-L/K) [m/s], from which on an oversteering vehicle is unstable; infinite without oversteer."""
    gradient = vehicle.understeer_gradient_rad_per_mps2
    return math.sqrt(-vehicle.wheelbase_m / gradient) if gradient < 0.0 else math.inf
