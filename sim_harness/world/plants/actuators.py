"""Actuators of every plant: dead time, lag, limits, friction and offset of steering and drive.

For a constant demand they have closed solutions, so nothing is integrated:

    steering   δ_s' = clip((demand(t - T) - δ_s)/τ, ±rate)        first order with a rate limit, dead time T
    tyres      δ = δ_s + p + offset,  p follows δ_s by the play operator: δ_s + p moves only when |p| would pass
               the half-width f, i.e. p ← clip(p - Δδ_s, ±f)
    drive      a' = (demand - a)/τ_a,   v' = a + p,   v ≥ 0,   with the pull p of the weight along the road

The play operator is a spring of stiffness k that turns the wheels against Coulomb friction of torque k·f, without
inertia: they stick until the spring is wound up by f, slip behind it by f, and stick again at every reversal.
Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.1.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.messages import Command

_SAME_INSTANT_S = 1e-9

Pending = tuple[tuple[float, float], ...]
Advance = Callable[[PlantState, float, float], PlantState]


class Actuation(NamedTuple):
    """Output of the actuators at one instant: the inputs of the equations of motion."""

    speed_mps: float
    accel_mps2: float
    tyre_angle_rad: float
    steering_rad: float
    play_rad: float


class Actuators:
    """Steering and drive of one vehicle."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings, *, grip_mps2: float) -> None:
        """``grip_mps2``: the largest longitudinal acceleration that the tyres transmit."""
        chassis = settings.chassis
        loaded = chassis.mass_kg / (chassis.mass_kg + settings.load_kg)  # the drive's force does not grow
        self.max_accel_mps2 = min(vehicle.max_accel_mps2 * loaded, grip_mps2)
        self.max_decel_mps2 = min(vehicle.max_decel_mps2 * loaded, grip_mps2)
        self.max_angle_rad = vehicle.max_road_wheel_angle_rad
        self.rate_radps = vehicle.max_road_wheel_rate_radps
        self.delay_s = vehicle.steering_delay_s
        self.lag_s = vehicle.steering_lag_s
        self.accel_lag_s = vehicle.accel_lag_s
        self.offset_rad = settings.steering_offset_rad
        self.friction_rad = settings.steering_friction_rad
        self.pull_mps2 = 0.0  # of the weight along the vehicle, - = uphill

    def drive(self, state: PlantState, command: Command, dt_s: float, advance: Advance) -> PlantState:
        """``state`` after ``dt_s`` under ``command``.

        A steering demand acts exactly ``delay_s`` after the command, also within a step: ``advance(state,
        acceleration demand, span)`` is called for spans of constant demand. Raises ValueError when a demand is not
        finite.
        """
        demand_rad, accel_mps2 = command.road_wheel_angle_rad, command.accel_mps2
        if not (math.isfinite(demand_rad) and math.isfinite(accel_mps2)):
            raise ValueError(f"demand must be finite, got {demand_rad} rad and {accel_mps2} m/s²")
        accel_mps2 = at_least(at_most(accel_mps2, self.max_accel_mps2), -self.max_decel_mps2)
        demand_rad, pending = within(demand_rad, self.max_angle_rad), state.pending
        if demand_rad != (pending[-1][1] if pending else state.acting_demand_rad):
            pending = (*pending, (state.clock_s + self.delay_s, demand_rad))
        left_s = dt_s
        while left_s > _SAME_INSTANT_S:
            if pending:
                state, pending = _take_due(state, pending)
            span_s = at_most(pending[0][0] - state.clock_s, left_s) if pending else left_s
            state = advance(state, accel_mps2, span_s)
            left_s -= span_s
        return state

    def at(self, state: PlantState) -> Actuation:
        steering_rad, play_rad = state.road_wheel_angle_rad, state.play_rad
        tyre_rad = steering_rad + play_rad + self.offset_rad
        return Actuation(state.speed_mps, state.accel_mps2, tyre_rad, steering_rad, play_rad)

    def after(self, state: PlantState, accel_demand_mps2: float, t: float) -> Actuation:
        """The motion ``t`` [s] after ``state`` under constant demands."""
        speed_mps, accel_mps2 = self._speed(state, accel_demand_mps2, t)
        steering_rad = self._steering(state, t)
        play_rad = 0.0
        if self.friction_rad > 0.0:
            play_rad = within(state.play_rad + state.road_wheel_angle_rad - steering_rad, self.friction_rad)
        tyre_rad = steering_rad + play_rad + self.offset_rad
        return Actuation(speed_mps, accel_mps2, tyre_rad, steering_rad, play_rad)

    def during(
        self, state: PlantState, accel_demand_mps2: float, h: float
    ) -> tuple[Actuation, Actuation, Actuation]:
        """The motion at the start, the middle and the end of a span of ``h`` [s] under constant demands."""
        middle = self.after(state, accel_demand_mps2, h / 2)
        return self.at(state), middle, self.after(state, accel_demand_mps2, h)

    def _speed(self, state: PlantState, demand_mps2: float, t: float) -> tuple[float, float]:
        """Speed, and acceleration by the drive, after ``t`` [s] under a constant demand.

        The speed never becomes negative: the brakes hold a car at rest on a hill.
        """
        v0, a0, lag_s = state.speed_mps, state.accel_mps2, self.accel_lag_s
        net_mps2 = demand_mps2 + self.pull_mps2
        if v0 == 0.0 and net_mps2 <= 0.0:
            return 0.0, 0.0
        decay = math.exp(-t / lag_s) if lag_s > 0.0 else 0.0
        accel_mps2 = demand_mps2 + (a0 - demand_mps2) * decay
        speed_mps = v0 + net_mps2 * t + (a0 - demand_mps2) * lag_s * (1.0 - decay)
        if speed_mps > 0.0:
            return speed_mps, accel_mps2
        return 0.0, at_least(accel_mps2, 0.0)

    def _steering(self, state: PlantState, t: float) -> float:
        """Angle of the steering after ``t`` [s]: full rate until the error is rate·τ, exponential from there."""
        error = state.acting_demand_rad - state.road_wheel_angle_rad
        if error == 0.0:
            return state.acting_demand_rad
        ramp_s = at_least(abs(error) / self.rate_radps - self.lag_s, 0.0)
        if t < ramp_s:
            return state.road_wheel_angle_rad + math.copysign(self.rate_radps * t, error)
        if self.lag_s == 0.0:
            return state.acting_demand_rad
        error_then = within(error, self.rate_radps * self.lag_s)
        return state.acting_demand_rad - error_then * math.exp((ramp_s - t) / self.lag_s)


def state_after(
    state: PlantState,
    end: Actuation,
    h: float,
    pose: tuple[float, float, float],
    inner: tuple[float, ...] = (),
) -> PlantState:
    """``state`` after a span of ``h`` [s] that ends with the motion ``end`` at ``pose`` (x, y, yaw)."""
    x_m, y_m, yaw_rad = pose
    return PlantState(
        x_m=x_m,
        y_m=y_m,
        yaw_rad=yaw_rad,
        speed_mps=end.speed_mps,
        accel_mps2=end.accel_mps2,
        road_wheel_angle_rad=end.steering_rad,
        acting_demand_rad=state.acting_demand_rad,
        pending=state.pending,
        clock_s=state.clock_s + h,
        play_rad=end.play_rad,
        inner=inner,
    )


def _take_due(state: PlantState, pending: Pending) -> tuple[PlantState, Pending]:
    """``state`` with the newest demand of ``pending`` whose dead time is over, and the remaining demands."""
    now_s, acting_rad = state.clock_s + _SAME_INSTANT_S, state.acting_demand_rad
    while pending and pending[0][0] <= now_s:
        acting_rad = pending[0][1]
        pending = pending[1:]
    if pending is state.pending and acting_rad == state.acting_demand_rad:
        return state, pending
    return _with_demands(state, acting_rad, pending), pending


def _with_demands(state: PlantState, acting_rad: float, pending: Pending) -> PlantState:
    """``state`` with other demands; twice as fast as dataclasses.replace."""
    return PlantState(
        x_m=state.x_m,
        y_m=state.y_m,
        yaw_rad=state.yaw_rad,
        speed_mps=state.speed_mps,
        accel_mps2=state.accel_mps2,
        road_wheel_angle_rad=state.road_wheel_angle_rad,
        acting_demand_rad=acting_rad,
        pending=pending,
        clock_s=state.clock_s,
        play_rad=state.play_rad,
        inner=state.inner,
    )
