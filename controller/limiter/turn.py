"""Road-wheel angle against path curvature in a steady turn: the equation of all limits.

    δ = atan(u) + c·u      u = L·κ      c = K_us·v²/L

It rises in u where 1/(1 + u²) + c > 0: everywhere for K_us ≥ 0, and for an oversteering car up to a tightest turn,
which shrinks to nothing at the critical speed √(-L/K_us). The equation is used where it rises by SLOPE at least,
and no faster than at STABLE of the critical speed; beyond, both functions return the value at the edge.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.2 and 3.3.

**Excess**: the lateral acceleration by the yaw rate beyond that of the bicycle model. A car turns in while braking
in a bend, its understeer on a slope or with a load differs from the vehicle file, and steering has an offset. All
of these are in

    e = v·ψ' - κ(δ)·v²

the lateral acceleration beyond that of the steady turn at the measured wheel angle, filtered with τ and led by T:
e + T·e' of the filtered e, with e' = (unfiltered - filtered)/τ. In transients the yaw rate follows the wheel late,
so that e has the sign opposite to the motion of the wheel: it narrows the limit on the side without demand.
"""

from math import atan, sqrt

from controller.limiter.inputs import SeenState
from controller.limiter.limits import Limits, clip
from trepid.car.vehicle import Vehicle

STABLE = 0.95
SLOPE = 0.02
STEEPEST = 1e-3  # keeps |u| ≤ 32, an angle of 88°, for cars that do not oversteer
NEWTON_STEPS = 7  # then |δ - δ(κ)| < 1e-9 rad; 1e-7 on the edge of an oversteering car


class SteadyTurn:
    """The steady turns of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._wheelbase_m = vehicle.wheelbase_m
        self._gradient = vehicle.understeer_gradient_rad_per_mps2

    def angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """δ(κ), rising."""
        compliance, tightest = self._shape(speed_mps)
        u = clip(self._wheelbase_m * curvature_1pm, (-tightest, tightest))
        return atan(u) + compliance * u

    def curvature_1pm(self, angle_rad: float, speed_mps: float) -> float:
        """κ(δ), rising. Left of its root the equation is concave, so that Newton from 0 climbs to it from below."""
        compliance, tightest = self._shape(speed_mps)
        u = 0.0
        for _ in range(NEWTON_STEPS):
            step = (angle_rad - atan(u) - compliance * u) / (1.0 / (1.0 + u * u) + compliance)
            u = max(-tightest, min(tightest, u + step))
        return u / self._wheelbase_m

    def _shape(self, speed_mps: float) -> tuple[float, float]:
        """c, and the largest |u| at which the equation still rises."""
        compliance = max(self._gradient * speed_mps * speed_mps / self._wheelbase_m, -STABLE * STABLE)
        return compliance, sqrt(1.0 / max(SLOPE - compliance, STEEPEST) - 1.0)


FILTER_S = 0.1  # τ, for gyroscopes with a noise of 0.002 rad/s
LEAD_S = 0.3  # T: delay of steering and filter


class Excess:
    """Call ``step`` with every plausible state."""

    def __init__(self, turn: SteadyTurn, limits: Limits) -> None:
        self._turn = turn
        self._most_mps2 = limits.yaw_share * limits.lateral_accel_mps2
        self._filtered_mps2 = 0.0

    def step(self, seen: SeenState, dt_s: float) -> float:
        """Lateral acceleration [m/s²] beyond the steady turn, + = to the left, within its bounds.

        Zero while yaw rate, wheel angle or speed is not measured.
        """
        if seen.yaw_rate_radps is None or seen.wheel_rad is None or not seen.measures_speed:
            self._filtered_mps2 = 0.0
            return 0.0
        steady_1pm = self._turn.curvature_1pm(seen.wheel_rad, seen.speed_mps)
        excess_mps2 = seen.speed_mps * (seen.yaw_rate_radps - steady_1pm * seen.speed_mps)
        rate_mps3 = (excess_mps2 - self._filtered_mps2) / (FILTER_S + dt_s)
        self._filtered_mps2 += rate_mps3 * dt_s
        return clip(self._filtered_mps2 + LEAD_S * rate_mps3, (-self._most_mps2, self._most_mps2))
