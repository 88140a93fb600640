"""Estimation of steering offset and understeer while driving.

The relation of ``trepid vehicle identify`` in steady state, one vehicle state at a time:

    θ - atan(L·(r - r₀)/v) = K·a - b + T·θ'        a = v·(r - r₀)

θ measured wheel angle, r measured yaw rate, v speed; K understeer gradient, b steering offset (tyres minus sensor),
r₀ zero error of the yaw rate, T the lag of yaw behind the wheels: that of the tyres by the vehicle
file (:func:`yaw_lag_s`, about 0.05 s) plus the estimated T₁. An extended Kalman filter estimates
x = (K, b, r₀, T₁) and its covariance P. Both sides pass the same low-pass of ``SMOOTH_S``, which keeps the relation
and removes noise from a and θ'. K, r₀ and T₁ hardly change, b is a random walk: old bends lose their weight slowly,
old offsets within a second (``WALK``). While the car stands, r is r₀.

A bank φ of the road reads as the offset -K·g·φ. Angle and yaw rate do not separate the two, and both need
the same wheel angle; b follows the bank within a second. A wheelbase error ΔL reads as understeer ΔL/v².

The relation holds under a driver's steering as well. The estimate is held when the car is slow, stands or
reverses (except r₀), beyond the linear range of the tyres, at a high yaw acceleration, when the limiter reports
saturation, or when angle, yaw rate or speed are unknown. Without lateral acceleration K is held.

Estimates stay within bounds around the vehicle file; K never falls below zero, or below the file's if that is,
so that no car becomes unstable at speed. The values in use follow the estimates so slowly that the lateral jerk
stays below 5/4·``max_jerk_mps3``. They are not stored: every start begins with the vehicle file, since a
serviced car must not drive with an old offset, and a new estimate takes seconds.

Kalman filter with random walks for parameters: Ljung, System Identification (1999), section 11.2. Schmidt's
treatment of a state that is held: Jazwinski, Stochastic Processes and Filtering Theory (1970), section 8.4.
"""

import math
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import GRADIENT, Vehicle
from trepid.config import Settings
from trepid.messages import VehicleState
from trepid.types import NonNegative, Positive

SMOOTH_S = 0.3  # an octave below the 1 Hz above which the tyres' own dynamics begin
UPDATE_S = 0.05  # between updates of the filter, which follows at 2 rad/s; the low-pass uses every state
LONGEST_STEP_S = 0.25  # after a longer gap the low-pass restarts
STANDING_MPS = 0.01  # wheel encoders are exact at standstill
UNKNOWN = (1.5e-3, 1e-2, 2e-3, 0.03)  # deviations of K [rad/(m/s²)], b [rad], r₀ [rad/s], T₁ [s] at the start
WALK = (1e-5, 3e-4, 1e-5, 1e-3)  # per √s: passengers, road bank, temperature, speed
ERROR_RAD = 1.5e-4  # rad·√s, density of the error of the relation; with the walk, b follows at 2 rad/s
STANDING_RADPS = 2e-4  # rad/s·√s of the yaw rate at standstill: 0.002 rad/s at 100 Hz
OUTLIER = 3.0  # deviations at which an error is limited
HARD_MPS2 = 12.0  # lateral acceleration at which K changes the angle as fast as b does
VISIBLE = 0.005  # of the bound of K: smaller changes do not make a new Vehicle


LEARNING = ("offset", "offset and understeer")
Rows = tuple[float, float, float, float]


def yaw_lag_s(vehicle: Vehicle, speed_mps: float) -> float:
    """Lag [s] of yaw behind a ramp of the wheels; 0 where the slip of the rear axle is not known.

    T = F·v - K·(F + R)·v³/(L + K·v²), F = R + K: the first-order term of the two axles of `controller.model.tyres`.
    """
    rear, gradient = vehicle.rear_slip_gradient_rad_per_mps2, vehicle.understeer_gradient_rad_per_mps2
    if rear == 0.0:
        return 0.0
    front, speed2 = rear + gradient, speed_mps * speed_mps
    held_m = vehicle.wheelbase_m + gradient * speed2
    return speed_mps * (front - gradient * (front + rear) * speed2 / held_m)


class LearningSettings(Settings):
    """``learning`` in ``config/controller.yaml``."""

    enabled: bool
    slowest_mps: Positive
    max_lateral_mps2: Positive  # beyond it tyres are not linear
    max_yaw_accel_radps2: Positive
    least_lateral_mps2: Positive  # below it the understeer is held
    max_offset_rad: Annotated[float, Field(gt=0, le=0.1)]
    # K stays within ± understeer_share of that of the vehicle file,
    # or ± understeer_span [rad/(m/s²)], whichever is wider.
    understeer_share: Annotated[float, Field(ge=0, lt=1)]
    understeer_span: NonNegative
    # By the offset; K adds a quarter: 5 in all (ISO 11270).
    max_jerk_mps3: Annotated[float, Field(gt=0, le=4.0)]


class SteeringLearner:
    """Call ``step`` with every vehicle state; it returns the state without the errors of its sensors."""

    def __init__(self, vehicle: Vehicle, settings: LearningSettings) -> None:
        """``vehicle``: start of the estimate and centre of its bounds."""
        self.vehicle = vehicle  # with the estimated understeer
        self.offset_rad = 0.0  # in use; tyres minus sensor
        self.doing = "waiting"
        self._settings = settings
        self._start = vehicle.understeer_gradient_rad_per_mps2
        self.understeer = self._start  # K in use; the vehicle follows in steps of VISIBLE
        self._span = max(settings.understeer_share * abs(self._start), settings.understeer_span)
        self._least = max(self._start - self._span, min(self._start, 0.0))
        self._filter = _Kalman([self._start, 0.0, 0.0, 0.0])
        self._smooth: _Smooth | None = None
        self._t_s: float | None = None  # of the last state
        self._pending_s = 0.0  # since the last update of the filter

    @property
    def yaw_rate_offset_radps(self) -> float:
        """r₀."""
        return self._filter.x[2]

    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of K [rad/(m/s²)], b [rad], r₀ [rad/s] and T₁ [s]."""
        return self._filter.deviations()

    def values(self) -> tuple[tuple[str, str], ...]:
        """For the diagnostics."""
        sigma = self.deviations()
        return (
            ("learning", self.doing),
            ("steering_offset_rad", f"{self.offset_rad:.5f} ± {sigma[1]:.5f}"),
            (GRADIENT, f"{self.understeer:.5f} ± {sigma[0]:.5f}"),
            ("yaw_rate_offset_radps", f"{self.yaw_rate_offset_radps:.5f} ± {sigma[2]:.5f}"),
        )

    def step(self, state: VehicleState) -> VehicleState:
        """Update with ``state``; returns it with the angle of the tyres and the yaw rate without its zero error."""
        dt_s = state.t_s - self._t_s if self._t_s is not None else 0.0
        if self._settings.enabled and (dt_s > 0.0 or self._t_s is None):
            self._t_s = state.t_s
            self.doing = self._learn(state, dt_s)
            self._follow(abs(state.speed_mps or 0.0), at_most(dt_s, LONGEST_STEP_S))
        angle_rad, rate = state.road_wheel_angle_rad, state.yaw_rate_radps
        if self.offset_rad == 0.0 and self.yaw_rate_offset_radps == 0.0:
            return state
        return replace(
            state,
            road_wheel_angle_rad=None if angle_rad is None else angle_rad + self.offset_rad,
            yaw_rate_radps=None if rate is None else rate - self.yaw_rate_offset_radps,
        )

    def command_rad(self, tyre_angle_rad: float) -> float:
        """Demand of the steering [rad] that sets the tyres to ``tyre_angle_rad``."""
        return tyre_angle_rad - self.offset_rad

    def _learn(self, state: VehicleState, dt_s: float) -> str:
        """Use ``state`` if the relation holds; returns the use made of it, or the reason for none."""
        speed_mps, angle_rad, rate = state.speed_mps, state.road_wheel_angle_rad, state.yaw_rate_radps
        if speed_mps is None or angle_rad is None or rate is None or dt_s > LONGEST_STEP_S:
            return self._pause("no measurement")
        if abs(speed_mps) <= STANDING_MPS:
            self._filter.walk(dt_s)
            self._filter.hold_gradient()
            self._filter.learn((0.0, 0.0, 1.0, 0.0), rate - self._filter.x[2], STANDING_RADPS**2, dt_s)
            self._bound_estimates()
            return self._pause("standing")
        if speed_mps < self._settings.slowest_mps:
            return self._pause("too slow")
        if self._smooth is None:
            self._smooth = _Smooth(self.vehicle.wheelbase_m, angle_rad, speed_mps, rate)
        self._smooth.step(angle_rad, speed_mps, rate, dt_s)
        if not self._steady(self._smooth, state):
            return "not steady"
        self._pending_s += dt_s
        if self._pending_s >= UPDATE_S:
            self.doing = self._update(self._smooth, speed_mps, self._pending_s)
            self._pending_s = 0.0
        return self.doing if self.doing in LEARNING else LEARNING[0]

    def _steady(self, smooth: "_Smooth", state: VehicleState) -> bool:
        """Whether the relation holds: tyres linear, yaw nearly settled, steering and tyres not at their limits."""
        return (
            not state.saturated
            and abs(smooth.lateral_mps2) <= self._settings.max_lateral_mps2
            and abs(smooth.yaw_accel_radps2) <= self._settings.max_yaw_accel_radps2
        )

    def _pause(self, why: str) -> str:
        """Restart the low-pass with the next usable state."""
        self._smooth, self._pending_s = None, 0.0
        return why

    def _update(self, smooth: "_Smooth", speed_mps: float, dt_s: float) -> str:
        """One step of the filter on θ - atan(L·r/v) = K·(v·r - v·r₀) - b - (L/v)·r₀ + T·θ'."""
        kalman, per_zero_s = self._filter, self.vehicle.wheelbase_m / speed_mps
        gradient, offset_rad, zero, lag_s = kalman.x
        lateral_mps2 = smooth.lateral_mps2 - speed_mps * zero
        lag_s += yaw_lag_s(self.vehicle, speed_mps)
        expected = gradient * lateral_mps2 - offset_rad - per_zero_s * zero + lag_s * smooth.angle_rate_radps
        bend = abs(lateral_mps2) >= self._settings.least_lateral_mps2
        kalman.walk(dt_s)
        if not bend:
            kalman.hold_gradient()
        rows = (
            lateral_mps2 if bend else 0.0,
            -1.0,
            -(per_zero_s + gradient * speed_mps),
            smooth.angle_rate_radps,
        )
        kalman.learn(rows, smooth.difference_rad - expected, ERROR_RAD**2, dt_s)
        self._bound_estimates()
        return LEARNING[1 if bend else 0]

    def _bound_estimates(self) -> None:
        """Keep the estimates within their bounds."""
        x = self._filter.x
        x[0] = at_least(at_most(x[0], self._start + self._span), self._least)
        x[1] = within(x[1], self._settings.max_offset_rad)

    def _follow(self, speed_mps: float, dt_s: float) -> None:
        """Move the values in use towards the estimates, within the jerk."""
        speed2 = at_least(speed_mps, self._settings.slowest_mps) ** 2
        per_mps2 = at_least(self.vehicle.wheelbase_m / speed2 + self.understeer, 0.0)  # ∂δ/∂a_y
        reach_rad = self._settings.max_jerk_mps3 * per_mps2 * dt_s
        gradient, offset_rad = self._filter.x[:2]
        self.offset_rad += within(offset_rad - self.offset_rad, reach_rad)
        self.understeer += within(gradient - self.understeer, reach_rad / HARD_MPS2)
        shown = self.vehicle.understeer_gradient_rad_per_mps2
        if abs(self.understeer - shown) > VISIBLE * self._span:
            self.vehicle = self.vehicle.model_copy(update={GRADIENT: self.understeer})


class _Smooth:
    """Both sides of the relation after the low-pass, and the rates of angle and yaw rate after it."""

    def __init__(self, wheelbase_m: float, angle_rad: float, speed_mps: float, rate: float) -> None:
        self._wheelbase_m = wheelbase_m
        self._angle_rad, self._rate = angle_rad, rate
        self.difference_rad = angle_rad - math.atan(wheelbase_m * rate / speed_mps)
        self.lateral_mps2 = speed_mps * rate
        self.angle_rate_radps = self.yaw_accel_radps2 = 0.0

    def step(self, angle_rad: float, speed_mps: float, rate: float, dt_s: float) -> None:
        share = dt_s / (SMOOTH_S + dt_s)
        self.angle_rate_radps = (angle_rad - self._angle_rad) / (SMOOTH_S + dt_s)
        self.yaw_accel_radps2 = (rate - self._rate) / (SMOOTH_S + dt_s)
        self._angle_rad += share * (angle_rad - self._angle_rad)
        self._rate += share * (rate - self._rate)
        now_rad = angle_rad - math.atan(self._wheelbase_m * rate / speed_mps)
        self.difference_rad += share * (now_rad - self.difference_rad)
        self.lateral_mps2 += share * (speed_mps * rate - self.lateral_mps2)


class _Kalman:
    """x = (K, b, r₀, T₁) as random walks, and the covariance P of its error."""

    def __init__(self, x: list[float]) -> None:
        self.x = x
        self._p = [[UNKNOWN[i] ** 2 if i == j else 0.0 for j in range(4)] for i in range(4)]

    def deviations(self) -> tuple[float, ...]:
        return tuple(math.sqrt(self._p[i][i]) for i in range(4))

    def walk(self, dt_s: float) -> None:
        """Add the random walk of ``dt_s``; no variance exceeds that of the start."""
        p = self._p
        for i, walk in enumerate(WALK):
            p[i][i] = at_most(p[i][i] + walk * walk * dt_s, UNKNOWN[i] ** 2)

    def hold_gradient(self) -> None:
        """Set the covariances of K with the others to 0, so that their errors do not change it."""
        p = self._p
        for i in (1, 2, 3):
            p[0][i] = p[i][0] = 0.0

    def learn(self, rows: Rows, error: float, density: float, dt_s: float) -> None:
        """Measurement ``error`` = ``rows``·(x_true - x) + noise of ``density`` [unit²·s], once per ``dt_s``."""
        if dt_s <= 0.0:
            return
        h0, h1, h2, h3 = rows
        p = self._p
        along = [q[0] * h0 + q[1] * h1 + q[2] * h2 + q[3] * h3 for q in p]
        variance = along[0] * h0 + along[1] * h1 + along[2] * h2 + along[3] * h3 + density / dt_s
        error = within(error, OUTLIER * math.sqrt(variance))
        for i, row in enumerate(p):
            gain = along[i] / variance
            self.x[i] += gain * error
            for j in range(4):
                row[j] -= gain * along[j]
