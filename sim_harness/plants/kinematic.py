"""The simulated vehicle: kinematic bicycle with understeer behind actuators with dead time, lag and limits.

State at the centre of the rear axle: position (x, y) [m] and yaw [rad] in the plane of the road, speed [m/s],
acceleration [m/s²], road-wheel angle [rad]. Inputs: demanded road-wheel angle [rad] and acceleration [m/s²].

    x' = v·cos ψ      y' = v·sin ψ      ψ' = v·κ      δ = atan(L·κ) + K_us·κ·v²

The last line holds at every instant: the tyres are taken to be in steady state (quasi-static understeer).
The actuators have closed solutions for a constant demand, so only the pose is integrated, by Runge-Kutta of
order 4.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.2 (kinematics) and 3.3 (understeer gradient).
"""

import math
from dataclasses import replace

from sim_harness.plants.state import PlantState
from trepid.messages import Command
from trepid.vehicle import Vehicle

_SAME_INSTANT_S = 1e-9
_NEWTON_STEPS = 6  # quadratic from below; five reach the last bit at every angle below 1.2 rad


class Plant:
    """Advances a :class:`PlantState`; holds nothing but the vehicle's parameters."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle

    def initial(
        self, x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0, speed_mps: float = 0.0
    ) -> PlantState:
        """Rolling straight ahead."""
        return PlantState(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, speed_mps=speed_mps)

    def step(self, state: PlantState, command: Command, dt_s: float) -> PlantState:
        """State after ``dt_s`` under ``command`` (its road-wheel angle and acceleration).

        A demand acts exactly ``steering_delay_s`` after it was given, also when that falls inside a step.
        Raises ValueError when a demand is not finite.
        """
        demand_rad, accel_mps2 = command.road_wheel_angle_rad, command.accel_mps2
        if not (math.isfinite(demand_rad) and math.isfinite(accel_mps2)):
            raise ValueError(f"demand must be finite, got {demand_rad} rad and {accel_mps2} m/s²")
        accel_mps2 = max(-self.vehicle.max_decel_mps2, min(self.vehicle.max_accel_mps2, accel_mps2))
        state = self._enqueue(state, demand_rad)
        left_s = dt_s
        while left_s > _SAME_INSTANT_S:
            state = _take_due(state)
            span_s = min(left_s, state.pending[0][0]) if state.pending else left_s
            state = self._advance(state, accel_mps2, span_s)
            left_s -= span_s
        return state

    def curvature_1pm(self, road_wheel_angle_rad: float, speed_mps: float) -> float:
        """Path curvature κ at the rear axle that solves δ = atan(L·κ) + K_us·κ·v².

        Newton from κ = 0. For K_us ≥ 0 the function is concave above zero, so every iterate stays below the
        root and the sequence rises to it. Raises ValueError where an oversteering vehicle (K_us < 0) has no
        steady state, as at and above its critical speed √(-L/K_us).
        """
        wheelbase_m = self.vehicle.wheelbase_m
        compliance = self.vehicle.understeer_gradient_rad_per_mps2 * speed_mps * speed_mps
        if compliance == 0.0:
            return math.tan(road_wheel_angle_rad) / wheelbase_m
        curvature = 0.0
        for _ in range(_NEWTON_STEPS):
            tangent = wheelbase_m * curvature
            residual = math.atan(tangent) + compliance * curvature - road_wheel_angle_rad
            slope = wheelbase_m / (1.0 + tangent * tangent) + compliance
            if slope <= 0.0:
                raise ValueError(f"{self.vehicle.name} has no steady state at {speed_mps} m/s: it oversteers")
            curvature -= residual / slope
        return curvature

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ' = v·κ."""
        return state.speed_mps * self.curvature_1pm(state.road_wheel_angle_rad, state.speed_mps)

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """v²·κ, positive to the left."""
        return state.speed_mps * self.yaw_rate_radps(state)

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """Road-wheel angle that holds ``curvature_1pm`` at ``speed_mps``, within the angle limit."""
        angle_rad = math.atan(self.vehicle.wheelbase_m * curvature_1pm)
        angle_rad += self.vehicle.understeer_gradient_rad_per_mps2 * curvature_1pm * speed_mps * speed_mps
        return _clip(angle_rad, self.vehicle.max_road_wheel_angle_rad)

    def _enqueue(self, state: PlantState, demand_rad: float) -> PlantState:
        demand_rad = _clip(demand_rad, self.vehicle.max_road_wheel_angle_rad)
        newest_rad = state.pending[-1][1] if state.pending else state.acting_demand_rad
        if demand_rad == newest_rad:
            return state
        return replace(state, pending=(*state.pending, (self.vehicle.steering_delay_s, demand_rad)))

    def _advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        """One Runge-Kutta step over ``h`` [s] during which every demand is constant."""
        v0, a0 = state.speed_mps, state.accel_mps2
        if v0 == 0.0 and accel_demand_mps2 <= 0.0:
            a0 = accel_demand_mps2 = 0.0  # the brakes hold; they do not push backwards
        v_mid, _ = self._speed(v0, a0, accel_demand_mps2, h / 2)
        v_end, a_end = self._speed(v0, a0, accel_demand_mps2, h)
        angle_mid = self._wheel(state, h / 2)
        angle_end = self._wheel(state, h)
        rate_0 = v0 * self.curvature_1pm(state.road_wheel_angle_rad, v0)
        rate_mid = v_mid * self.curvature_1pm(angle_mid, v_mid)
        rate_end = v_end * self.curvature_1pm(angle_end, v_end)

        yaw_1 = state.yaw_rad
        yaw_2 = yaw_1 + h / 2 * rate_0
        yaw_3 = yaw_1 + h / 2 * rate_mid
        yaw_4 = yaw_1 + h * rate_mid
        x_rates = (
            v0 * math.cos(yaw_1) + 2 * v_mid * (math.cos(yaw_2) + math.cos(yaw_3)) + v_end * math.cos(yaw_4)
        )
        y_rates = (
            v0 * math.sin(yaw_1) + 2 * v_mid * (math.sin(yaw_2) + math.sin(yaw_3)) + v_end * math.sin(yaw_4)
        )
        return PlantState(
            x_m=state.x_m + h / 6 * x_rates,
            y_m=state.y_m + h / 6 * y_rates,
            yaw_rad=yaw_1 + h / 6 * (rate_0 + 4 * rate_mid + rate_end),
            speed_mps=v_end,
            accel_mps2=a_end if v_end > 0.0 else max(0.0, a_end),
            road_wheel_angle_rad=angle_end,
            acting_demand_rad=state.acting_demand_rad,
            pending=tuple((due_s - h, demand_rad) for due_s, demand_rad in state.pending),
        )

    def _speed(self, v0: float, a0: float, demand_mps2: float, t: float) -> tuple[float, float]:
        """Speed and acceleration after ``t`` [s] of a' = (demand - a)/τ, v' = a, with v ≥ 0."""
        lag_s = self.vehicle.accel_lag_s
        decay = math.exp(-t / lag_s) if lag_s > 0.0 else 0.0
        accel_mps2 = demand_mps2 + (a0 - demand_mps2) * decay
        speed_mps = v0 + demand_mps2 * t + (a0 - demand_mps2) * lag_s * (1.0 - decay)
        return max(0.0, speed_mps), accel_mps2

    def _wheel(self, state: PlantState, t: float) -> float:
        """Wheel angle after ``t`` [s] of δ' = clip((demand - δ)/τ, ±rate).

        At full rate until the error is rate·τ, an exponential approach from there.
        """
        rate, lag_s = self.vehicle.max_road_wheel_rate_radps, self.vehicle.steering_lag_s
        error = state.acting_demand_rad - state.road_wheel_angle_rad
        ramp_s = max(0.0, abs(error) / rate - lag_s)
        if t < ramp_s:
            return state.road_wheel_angle_rad + math.copysign(rate * t, error)
        if lag_s == 0.0:
            return state.acting_demand_rad
        error_then = _clip(error, rate * lag_s)
        return state.acting_demand_rad - error_then * math.exp((ramp_s - t) / lag_s)


def _take_due(state: PlantState) -> PlantState:
    """Let the newest demand whose dead time is over act."""
    due = [demand_rad for due_s, demand_rad in state.pending if due_s <= _SAME_INSTANT_S]
    if not due:
        return state
    return replace(state, acting_demand_rad=due[-1], pending=state.pending[len(due) :])


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
