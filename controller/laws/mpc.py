"""Lateral control by nonlinear model-predictive control in the spatial domain, with LQI as fallback.

The law optimises the change of the demanded curvature κ_c over N stages of length h·ℓ along the lane:

    min Σ ½·h·(e² + q_p·p² + q_a·(a - a_lane)² + ρ²·(w - w_lane)²) + price of |e| beyond a soft bound + cost to go

in the scaled states of `controller.laws.mpc_model`: offset e, heading error p = ℓ·ψ, curvature a = ℓ²·κ_a of the
path and its change w = ℓ³·dκ_c/ds. Without limits and lag the best loop is (ℓ·s + 1)²·(ρ·ℓ·s + 1) = 0: the car
returns within about 6·ℓ and does not overshoot, at any speed. ℓ = max(1/ω_s, v/ω_t) is a length when slow and a
time when fast; a controller in time alone grows 25-fold from 2 to 10 m/s. ω_t falls with dead time and lag, so
that slow steering gives a slow loop, robust to errors of both.

The horizon starts at the moment the command acts (:class:`controller.laws.law.Acting`): it has no delay.

- Wheel angle and lateral acceleration limit κ_c, wheel rate and lateral jerk its change, d(κ_c·v²)/dt with the part
  2·v·a·κ of speeding up or slowing down in a bend. They are constraints.
- The lags of steering τ and tyres T count as one of τ + T, from the curvature (T·κ_path + τ·κ_wheel)/(T + τ), from
  which the integral of the error is that of both lags in series.
- A car too far away to return directly follows a line that meets the lane at the approach angle.

Outside the model (reversing, standing across the lane, inside the centre of its bend) or without a valid solution
(:mod:`controller.laws.mpc_solver`), LQI steers in the same call.

Verschueren et al., Towards time-optimal race car driving using nonlinear MPC (2014), section II.
"""

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from controller.laws.law import Acting, LateralLaw
from controller.model.bicycle import curvature_from_angle
from controller.model.tyres import Tyres
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.config import Settings
from trepid.types import Positive

if TYPE_CHECKING:
    from controller.laws.mpc_model import Problem

_MIN_SPEED_MPS = 1.0  # below it a second counts as a metre, so that the wheels can turn at standstill
_LEAST_LAG = 1e-3  # θ of an immediate steering; e^(-h/θ) is zero then
_STEEPEST = math.exp(-1.0)  # on the way back (1 + s)·e^-s of the two slow poles: heading over offset
# Limits of the model.
_FASTEST_MPS = 100.0
_FARTHEST_M = 20.0
_FARTHEST_RAD = 0.8
_TIGHTEST_1PM = 1.0
_INNERMOST = 0.6  # of the bend's radius; towards 1, "along the lane" loses its meaning
_MOST_DRIFT = 0.8  # share of the jerk that a change of speed may take, so that zero stays allowed


class MpcSettings(Settings):
    """``lateral.mpc`` in ``config/controller.yaml``."""

    bandwidth_radpm: Positive  # ω_s
    bandwidth_radps: Positive  # ω_t
    quickness: Annotated[float, Field(ge=0.1, le=1.0)]  # ρ
    lag_rad: Positive  # ω_t times dead time and lag is no more
    max_approach_rad: Annotated[float, Field(gt=0, lt=0.7)]
    max_approach_mps: Positive
    stages: Annotated[int, Field(ge=5, le=60)]  # N
    stage: Annotated[float, Field(ge=0.05, le=0.5)]  # h, in ℓ
    max_lateral_mps2: Positive
    max_jerk_mps3: Positive
    soft_offset_m: Positive  # beyond it an offset costs more
    soft_price: tuple[Positive, Positive]  # per metre and half per square metre beyond; an e² costs ½


class Mpc(LateralLaw):
    """The law. casadi and daqp are imported here, since other laws and most commands do not need them."""

    def __init__(
        self, settings: MpcSettings, vehicle: Vehicle, *, command_delay_s: float, fallback: LateralLaw
    ) -> None:
        from controller.laws.mpc_model import Grid
        from controller.laws.mpc_solver import Soft, Solver

        self.doing = "nothing yet"
        self._settings, self._vehicle, self._fallback = settings, vehicle, fallback
        self._tyres = Tyres(vehicle)
        self._dead_s = command_delay_s + vehicle.steering_delay_s
        self._solver = Solver(
            Grid(settings.stages, settings.stage, settings.quickness), Soft(*settings.soft_price)
        )
        self._demand_1pm: float | None = None  # κ_c of the last call
        self._speed_mps = 0.0  # of the last call
        self._length_m = math.inf  # ℓ of the last call

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        demand_1pm = self._plan(at, dt_s)
        if demand_1pm is None:
            demand_1pm = self._fall_back(at, dt_s)
        self._demand_1pm = demand_1pm
        return demand_1pm

    def release(self) -> None:
        """Reset plan and last command."""
        self._solver.reset()
        self._fallback.release()
        self._demand_1pm = None

    def _fall_back(self, at: Acting, dt_s: float) -> float:
        """κ_cmd of the fallback; the last demand where the input is not finite."""
        self._solver.reset()
        if not _finite(at):
            return self._demand_1pm or 0.0
        demand_1pm = self._fallback.curvature(at, dt_s=dt_s)
        return demand_1pm if math.isfinite(demand_1pm) else self._demand_1pm or 0.0

    def _plan(self, at: Acting, dt_s: float) -> float | None:
        """κ_cmd of the plan; None without a valid one, with the reason in ``doing``."""
        if not (_finite(at) and _is_within_model(at)):
            self.doing = "falling back: outside the model"
            return None
        now = self._problem(at, dt_s)
        along = at_least(at.speed_mps, _MIN_SPEED_MPS) * dt_s / now.length_m
        scale = (now.length_m / self._length_m) ** 3
        self._length_m, self._speed_mps = now.length_m, at.speed_mps
        plan = self._solver.solve(now, shift=at_most(along / self._settings.stage, 1.0), scale=scale)
        if plan is None:
            self.doing = "falling back: no solution"
            return None
        if self.doing != "planning":
            self._fallback.release()
            self.doing = "planning"
        return (now.scaled_command_m + float(plan[0]) * along) / now.length_m**2

    def _problem(self, at: Acting, dt_s: float) -> "Problem":
        from controller.laws.mpc_model import Problem

        settings, lane = self._settings, at.lane
        speed_mps = at_least(at.speed_mps, _MIN_SPEED_MPS)
        lag_s, turning_1pm = self._lagging(at, speed_mps)
        slowest_s = at_least(1.0 / settings.bandwidth_radps, (self._dead_s + lag_s) / settings.lag_rad)
        length_m = at_least(speed_mps * slowest_s, 1.0 / settings.bandwidth_radpm)
        demand_1pm = self._demand_1pm if self._demand_1pm is not None else at.steady_1pm
        rates = self._rates(demand_1pm, speed_mps, dt_s)
        approach = math.tan(self._approach(speed_mps))
        excess_m = at_least(abs(lane.offset_m) - length_m * approach / _STEEPEST, 0.0)
        return Problem(
            offset_m=lane.offset_m,
            scaled_heading_m=length_m * lane.heading_rad,
            scaled_curvature_m=length_m**2 * turning_1pm,
            scaled_command_m=length_m**2 * demand_1pm,
            length_m=length_m,
            lag=at_least(speed_mps * lag_s / length_m, _LEAST_LAG),
            curvature_1pm=lane.curvature_1pm,
            curvature_rate_1pm2=lane.curvature_rate_1pm2,
            lookahead_m=lane.lookahead_m,
            excess_m=math.copysign(excess_m, lane.offset_m),
            approach=approach,
            rate_low=length_m**3 / speed_mps * rates[0],
            rate_high=length_m**3 / speed_mps * rates[1],
            most_command_m=length_m**2 * self._tightest(speed_mps),
            most_offset_m=settings.soft_offset_m,
        )

    def _lagging(self, at: Acting, speed_mps: float) -> tuple[float, float]:
        """The common lag [s] of steering and tyres, and the curvature [1/m] of its state."""
        steering_s, tyres_s = self._vehicle.steering_lag_s, self._tyres.lag_s(speed_mps)
        both_s = steering_s + tyres_s
        if both_s == 0.0:
            return 0.0, at.curvature_1pm
        return both_s, (tyres_s * at.curvature_1pm + steering_s * at.steady_1pm) / both_s

    def _rates(self, demand_1pm: float, speed_mps: float, dt_s: float) -> tuple[float, float]:
        """Lowest and highest dκ_c/dt [1/(m·s)]; zero lies between them."""
        settings, vehicle, speed2 = self._settings, self._vehicle, speed_mps * speed_mps
        slope = at_least(vehicle.wheelbase_m + vehicle.understeer_gradient_rad_per_mps2 * speed2, 1e-3)
        most = vehicle.max_road_wheel_rate_radps / slope  # of straight wheels; bent ones turn more
        drift_mps3 = 0.0
        if dt_s > 0.0 and self._demand_1pm is not None:
            before_mps = at_least(self._speed_mps, _MIN_SPEED_MPS)
            drift_mps3 = demand_1pm * (speed2 - before_mps * before_mps) / dt_s
            drift_mps3 = within(drift_mps3, _MOST_DRIFT * settings.max_jerk_mps3)
        low, high = ((sign * settings.max_jerk_mps3 - drift_mps3) / speed2 for sign in (-1.0, 1.0))
        return at_least(low, -most), at_most(high, most)

    def _tightest(self, speed_mps: float) -> float:
        """Largest curvature [1/m] that wheel angle and lateral acceleration allow."""
        angle_rad, vehicle = self._vehicle.max_road_wheel_angle_rad, self._vehicle
        most_1pm = curvature_from_angle(angle_rad, speed_mps=speed_mps, vehicle=vehicle)
        if most_1pm is None:  # oversteer: acceleration is the tighter limit
            most_1pm = math.tan(angle_rad) / vehicle.wheelbase_m
        return at_most(self._settings.max_lateral_mps2 / (speed_mps * speed_mps), most_1pm)

    def _approach(self, speed_mps: float) -> float:
        """Largest approach angle [rad]."""
        sideways = at_most(self._settings.max_approach_mps / speed_mps, 1.0)
        return at_most(math.asin(sideways), self._settings.max_approach_rad)


def _finite(at: Acting) -> bool:
    """Whether every input of a law is finite."""
    return math.isfinite(sum(at.lane) + at.speed_mps + at.curvature_1pm + at.steady_1pm)


def _is_within_model(at: Acting) -> bool:
    """Whether car and lane lie within the limits of the model."""
    lane = at.lane
    return (
        0.0 <= at.speed_mps <= _FASTEST_MPS
        and abs(lane.offset_m) <= _FARTHEST_M
        and abs(lane.heading_rad) <= _FARTHEST_RAD
        and abs(lane.curvature_1pm * lane.offset_m) <= _INNERMOST
        and max(map(abs, (lane.curvature_1pm, at.curvature_1pm, at.steady_1pm))) <= _TIGHTEST_1PM
    )
