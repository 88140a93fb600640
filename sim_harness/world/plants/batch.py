"""Vectorised kinematic plants: one array per quantity, one Runge-Kutta step for all.

The equations are those of `sim_harness.world.plants.kinematic` and `sim_harness.world.plants.actuators`; each
vehicle may have its own parameters, and the grade and bank on which it stood at the start; only the period is
common, and dead times are whole numbers of periods.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_harness.world.plants.kinematic import KinematicPlant
from trepid.types import Array, Mask

_NEWTON_STEPS = 20  # three or four in practice
_LAST_STEP_RAD = 1e-9
_WHOLE = 1e-6  # of a period


@dataclass(slots=True, kw_only=True)
class BatchState:
    """``PlantState`` of N vehicles, shapes (N,); ``step`` replaces the arrays."""

    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array
    accel_mps2: Array
    road_wheel_angle_rad: Array
    acting_demand_rad: Array
    play_rad: Array
    pending_rad: list[Array] = field(default_factory=list)  # demands within their dead time, the latest first


class BatchPlant:
    """N kinematic plants under one period."""

    def __init__(self, plants: Sequence[KinematicPlant], *, period_s: float) -> None:
        """Raises ValueError when a dead time is not a whole number of periods."""
        actuators = [plant.actuators for plant in plants]
        self.period_s = period_s
        self._wheelbase_m = np.array([plant.wheelbase_m for plant in plants])
        self._gradient = np.array([plant.understeer_rad_per_mps2 for plant in plants])
        self._bank_mps2 = np.array([plant.bank_mps2 for plant in plants])
        self._grip2 = np.array([plant.grip_mps2**2 for plant in plants])
        self._pull_mps2 = np.array([a.pull_mps2 for a in actuators])
        self._max_accel_mps2 = np.array([a.max_accel_mps2 for a in actuators])
        self._max_decel_mps2 = np.array([a.max_decel_mps2 for a in actuators])
        self._max_angle_rad = np.array([a.max_angle_rad for a in actuators])
        self._rate_radps = np.array([a.rate_radps for a in actuators])
        self._lag_s = np.array([a.lag_s for a in actuators])
        self._accel_lag_s = np.array([a.accel_lag_s for a in actuators])
        self._offset_rad = np.array([a.offset_rad for a in actuators])
        self._friction_rad = np.array([a.friction_rad for a in actuators])
        delays_s = np.array([a.delay_s for a in actuators])
        periods = delays_s / period_s
        self._delay_periods = np.rint(periods).astype(np.int64)
        if (np.abs(periods - self._delay_periods) > _WHOLE).any():
            raise ValueError(f"dead times must be whole numbers of {period_s} s, got {np.unique(delays_s)}")
        # Without lag the decay is 0 instead of exp(-t/0).
        self._decays = {
            t: np.array([math.exp(-t / lag) if lag > 0.0 else 0.0 for lag in self._accel_lag_s])
            for t in (period_s / 2, period_s)
        }
        self._safe_lag_s = np.where(self._lag_s > 0.0, self._lag_s, 1.0)

    def initial(self, speed_mps: Array) -> BatchState:
        """At the origin, straight ahead, with the steering centred."""
        zeros = np.zeros(len(speed_mps))
        return BatchState(
            x_m=zeros,
            y_m=zeros,
            yaw_rad=zeros,
            speed_mps=np.array(speed_mps, dtype=np.float64),
            accel_mps2=zeros,
            road_wheel_angle_rad=zeros,
            acting_demand_rad=zeros,
            play_rad=zeros,
            pending_rad=[zeros] * int(self._delay_periods.max(initial=0)),
        )

    def step(self, state: BatchState, angle_demand_rad: Array, accel_demand_mps2: Array) -> None:
        """Advance ``state`` by one period under demanded angles and accelerations, shapes (N,).

        Raises ValueError when a demand is not finite or an oversteering vehicle has no steady state.
        """
        if not (np.isfinite(angle_demand_rad).all() and np.isfinite(accel_demand_mps2).all()):
            raise ValueError("every demand must be finite")
        h = self.period_s
        demand_mps2 = np.clip(accel_demand_mps2, -self._max_decel_mps2, self._max_accel_mps2)
        self._enqueue(state, np.clip(angle_demand_rad, -self._max_angle_rad, self._max_angle_rad))
        standing = (state.speed_mps == 0.0) & (demand_mps2 + self._pull_mps2 <= 0.0)
        v_0 = state.speed_mps
        v_mid, a_mid = self._speed(state, demand_mps2, standing, h / 2)
        v_end, a_end = self._speed(state, demand_mps2, standing, h)
        error_rad = state.acting_demand_rad - state.road_wheel_angle_rad
        mid_rad, end_rad = self._steering(state, error_rad, h / 2), self._steering(state, error_rad, h)
        mid_play, end_play = self._play(state, mid_rad), self._play(state, end_rad)
        rate_0 = v_0 * self._curvature(state.road_wheel_angle_rad + state.play_rad, v_0, state.accel_mps2)
        rate_mid = v_mid * self._curvature(mid_rad + mid_play, v_mid, a_mid)
        rate_end = v_end * self._curvature(end_rad + end_play, v_end, a_end)
        self._move(state, v_mid, v_end, rate_0, rate_mid, rate_end)
        state.speed_mps, state.accel_mps2 = v_end, a_end
        state.road_wheel_angle_rad, state.play_rad = end_rad, end_play

    def _enqueue(self, state: BatchState, demand_rad: Array) -> None:
        """Queue ``demand_rad``; the demand queued one dead time ago acts now."""
        state.pending_rad.insert(0, demand_rad)
        delays = self._delay_periods
        if (delays == delays[0]).all():
            state.acting_demand_rad = state.pending_rad[delays[0]]
        else:
            state.acting_demand_rad = np.stack(state.pending_rad)[delays, np.arange(delays.size)]
        state.pending_rad.pop()

    def _move(
        self, state: BatchState, v_mid: Array, v_end: Array, rate_0: Array, rate_mid: Array, rate_end: Array
    ) -> None:
        """The Runge-Kutta step of the pose."""
        h, v_0, yaw_1 = self.period_s, state.speed_mps, state.yaw_rad
        yaw_2 = yaw_1 + h / 2 * rate_0
        yaw_3 = yaw_1 + h / 2 * rate_mid
        yaw_4 = yaw_1 + h * rate_mid
        x_rates = v_0 * np.cos(yaw_1) + 2 * v_mid * (np.cos(yaw_2) + np.cos(yaw_3)) + v_end * np.cos(yaw_4)
        y_rates = v_0 * np.sin(yaw_1) + 2 * v_mid * (np.sin(yaw_2) + np.sin(yaw_3)) + v_end * np.sin(yaw_4)
        state.x_m = state.x_m + h / 6 * x_rates
        state.y_m = state.y_m + h / 6 * y_rates
        state.yaw_rad = yaw_1 + h / 6 * (rate_0 + 4 * rate_mid + rate_end)

    def _speed(self, state: BatchState, demand_mps2: Array, standing: Mask, t: float) -> tuple[Array, Array]:
        decay = self._decays[t]
        missing = state.accel_mps2 - demand_mps2
        accel_mps2 = demand_mps2 + missing * decay
        speed_mps = (
            state.speed_mps
            + (demand_mps2 + self._pull_mps2) * t
            + missing * self._accel_lag_s * (1.0 - decay)
        )
        stopped = standing | (speed_mps <= 0.0)
        if not stopped.any():
            return speed_mps, accel_mps2
        accel_mps2 = np.where(stopped, np.where(standing, 0.0, np.maximum(0.0, accel_mps2)), accel_mps2)
        return np.where(stopped, 0.0, speed_mps), accel_mps2

    def _steering(self, state: BatchState, error_rad: Array, t: float) -> Array:
        ramp_s = np.maximum(0.0, np.abs(error_rad) / self._rate_radps - self._lag_s)
        reach_rad = self._rate_radps * self._lag_s
        then_rad = np.clip(error_rad, -reach_rad, reach_rad)
        settling = state.acting_demand_rad - then_rad * np.exp(np.minimum(0.0, ramp_s - t) / self._safe_lag_s)
        ramping = state.road_wheel_angle_rad + np.copysign(self._rate_radps * t, error_rad)
        return np.where(t < ramp_s, ramping, settling)

    def _play(self, state: BatchState, steering_rad: Array) -> Array:
        play_rad = state.play_rad + state.road_wheel_angle_rad - steering_rad
        return np.clip(play_rad, -self._friction_rad, self._friction_rad)

    def _curvature(self, angle_rad: Array, speed_mps: Array, accel_mps2: Array) -> Array:
        """As :meth:`KinematicPlant.curvature_1pm`, until the last vehicle has converged."""
        speed2 = speed_mps * speed_mps
        compliance = self._gradient * speed2 / self._wheelbase_m
        rest_rad = angle_rad + self._offset_rad - self._gradient * self._bank_mps2
        theta = rest_rad / (1.0 + compliance)
        for _ in range(_NEWTON_STEPS):
            tangent = np.tan(theta)
            growth = 1.0 + tangent * tangent
            slope = 1.0 + compliance * growth
            if slope.min() <= 0.0:
                raise ValueError("a vehicle has no steady state at its speed: it oversteers")
            step = (rest_rad - theta - compliance * tangent) / slope
            if np.abs(step).max() < _LAST_STEP_RAD:
                break
            theta = theta + step
        curvature = (tangent + growth * step) / self._wheelbase_m
        lateral_mps2 = curvature * speed2 + self._bank_mps2
        left = self._grip2 - accel_mps2 * accel_mps2
        slides = lateral_mps2 * lateral_mps2 > left
        if not slides.any():
            return curvature
        with np.errstate(divide="ignore", invalid="ignore"):
            slid = (np.copysign(np.sqrt(np.maximum(0.0, left)), lateral_mps2) - self._bank_mps2) / speed2
        return np.where(slides, np.where(speed2 > 0.0, slid, 0.0), curvature)
