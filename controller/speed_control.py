"""Speed control: targets and stops -> a jerk-limited acceleration demand.

The acceleration demand of tracking is

    a = k·(v_t - v) + v_t' - d

v_t' is that of the target, or else its measured change, smoothed over ``RATE_S``: without it a car
behind a leader that brakes with b would lag its falling cap by b/k, and at a gap (d - d₀)/T the loop
s² + k·s + k/T would swing (damping 0.55 at k = 0.8 1/s, T = 1.5 s); with it the poles are k and 1/T. A change that
no car could make is a step of the cap, and not a rate. A target may stop rising at any time: v_t' makes the demand
k₂·(v_t - v) at most, and a rising target is followed v_t'/k₂ below it, k₂ = 1/(3·(τ_a + dt)). d is the load of the
hill, observed. With drive lag τ_a the loop s² τ_a + s + k has damping 1/(2√(k·τ_a)); above 1 the speed never
overshoots its cap. The demand must also be able to fade out as fast as k·a demands: k·max_accel ≤ brake_jerk. Both
are checked on loading.

A stop goes to its deceleration b at its jerk j and falls off with √(2·j·v), v being the speed when the demand acts,
so that the car does not lurch at the end; it then holds the brake at standstill. From v it takes, but for the last
deceleration not being zero,

    v/b + b/j + τ_a [s]        v²/(2b) + v·(b/(2j) + τ_a) + b³/(24·j²) [m]

Rajamani, Vehicle Dynamics and Control (2012), sections 5.4 and 6.3.

**Load**: acceleration of the car that its drive and brakes do not explain, such as that of a hill.

    v' = a + d        a' = (demand - a)/τ_a        d' = 0

d = -g·sin θ - rolling and air drag [m/s²], estimated by an observer with both poles at ``BANDWIDTH_RADPS``:

    v̂' = a + d̂ + 2ω·(v - v̂)        d̂' = ω²·(v - v̂)

Added to the demand it acts as an integral, but without wind-up while the demand is bounded and without response
to a new target. An error beyond ``TORN_MPS``, as from a driver's brake, resets the model.

Luenberger, An introduction to observers, IEEE TAC 16(6), 1971; Rajamani, Vehicle Dynamics and Control (2012),
section 4.1 (longitudinal forces).
"""

import math

from controller.model.tyres import remaining_share
from controller.speed_limits import SpeedSettings, Target
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.messages import Stop

BANDWIDTH_RADPS = 1.0
TORN_MPS = 0.5  # a sudden hill of 20 % gives 0.25 m/s


class LoadObserver:
    """Call ``step`` with the demand that has acted since the last step."""

    def __init__(self, drive_lag_s: float, *, limit_mps2: float) -> None:
        self.load_mps2 = 0.0  # d̂
        self.acting_mps2 = 0.0  # a
        self._lag_s, self._limit_mps2 = drive_lag_s, limit_mps2
        self._speed_mps: float | None = None  # v̂; None: to be read first

    def step(self, demand_mps2: float, *, speed_mps: float, dt_s: float) -> None:
        """Update with the speed after ``dt_s`` of ``demand_mps2``."""
        before_mps2 = self.acting_mps2
        keep = remaining_share(dt_s, self._lag_s)
        self.acting_mps2 = demand_mps2 + (before_mps2 - demand_mps2) * keep
        gained_mps = demand_mps2 * dt_s + (before_mps2 - demand_mps2) * self._lag_s * (1.0 - keep)
        if self._speed_mps is None:
            self._speed_mps = speed_mps
            return
        self._speed_mps += gained_mps + self.load_mps2 * dt_s
        error = speed_mps - self._speed_mps
        if abs(error) > TORN_MPS:
            self._speed_mps = speed_mps
            return
        self._speed_mps += 2.0 * BANDWIDTH_RADPS * dt_s * error
        self.load_mps2 = within(self.load_mps2 + BANDWIDTH_RADPS**2 * dt_s * error, self._limit_mps2)

    def standing(self) -> None:
        """The car stands: the brake holds, and the load stays as estimated."""
        self.acting_mps2, self._speed_mps = 0.0, None

    def pause(self) -> None:
        """The acting demand is not known."""
        self._speed_mps = None


RATE_S = 0.5
STEP_MPS = 0.4  # between two decisions (40 ms): ten times the change that a car can make
HOLD_JERK_MPS3 = 0.25  # of the holding brake at the last centimetres
STOOD_MPS = 0.01
HILL_SHARE = 0.5
STRONGEST_MPS2 = 4.0  # UN R157 5.3


class SpeedControl:
    """Call ``track`` or ``stop`` in every step. Starts with the brake applied."""

    def __init__(self, settings: SpeedSettings, vehicle: Vehicle, *, enlargement: float = 1.0) -> None:
        """``enlargement``: of the world of both relative to that of the car; gravity grows with it."""
        self._settings = settings
        self._strongest_mps2, self._step_mps = STRONGEST_MPS2 * enlargement, STEP_MPS * enlargement
        self._lag_s, self._standstill_mps = vehicle.accel_lag_s, vehicle.standstill_mps
        self._load = LoadObserver(self._lag_s, limit_mps2=settings.max_load_mps2)
        self._goal_mps: float | None = None  # the last target of tracking, ...
        self._smooth_mps = 0.0  # ... and the same smoothed
        self._given_mps2 = -settings.hold_decel_mps2  # the last demand, hill included
        self.accel_mps2 = -settings.hold_decel_mps2  # the last acceleration wanted

    def track(self, goal: Target, *, speed_mps: float, dt_s: float) -> float:
        """Acceleration demand [m/s²] towards ``goal``; stops and holds the brake where the target is standstill."""
        settings = self._settings
        away_mps = goal.speed_mps - speed_mps
        near_mps2, quick_1ps = settings.gain_1ps * away_mps, 1.0 / (3.0 * (self._lag_s + dt_s))
        quick_1ps = at_most(quick_1ps, settings.brake_jerk_mps3 / settings.max_accel_mps2)
        wanted = at_most(near_mps2 + self._rate(goal, dt_s), at_least(quick_1ps * away_mps, near_mps2))
        wanted = at_least(at_most(wanted, settings.max_accel_mps2), -settings.max_decel_mps2)
        if goal.speed_mps <= self._standstill_mps:
            if wanted >= -settings.comfort.decel_mps2:
                return self.stop(Stop.COMFORT, speed_mps=speed_mps, dt_s=dt_s)
            self.accel_mps2 = at_most(self.accel_mps2, 0.0)
        self._observe(speed_mps, dt_s)
        self._towards(wanted, settings.jerk_mps3 * dt_s, settings.brake_jerk_mps3 * dt_s)
        return self._give(self.accel_mps2 - self._load.load_mps2)

    def stop(self, how: Stop, *, speed_mps: float | None, dt_s: float) -> float:
        """Acceleration demand [m/s²], never positive, that stops the car and holds it.

        Uphill the brake is reduced by at most half, since the hill is an estimate. ``speed_mps`` None: the
        speed is not known; the brake stays applied.
        """
        settings, self._goal_mps = self._settings, None
        profile = settings.emergency if how is Stop.EMERGENCY else settings.comfort
        decel_mps2, jerk_mps3 = profile.decel_mps2, profile.jerk_mps3
        self._observe(speed_mps, dt_s)
        if speed_mps is not None and speed_mps <= self._standstill_mps:
            decel_mps2, jerk_mps3 = settings.hold_decel_mps2, HOLD_JERK_MPS3
        elif speed_mps is not None:
            acts_at_mps = at_least(speed_mps + self._load.acting_mps2 * self._lag_s, 0.0)
            soft = math.sqrt(2.0 * jerk_mps3 * acts_at_mps)
            decel_mps2 = at_most(decel_mps2, at_least(soft, profile.final_decel_mps2))
        self.accel_mps2 = at_most(self.accel_mps2, 0.0)  # no drive from now on
        self._towards(-decel_mps2, jerk_mps3 * dt_s, jerk_mps3 * dt_s)
        load_mps2 = self._load.load_mps2
        if speed_mps is not None and speed_mps <= STOOD_MPS:  # a brake holds either way
            load_mps2 = abs(load_mps2)
        return self._give(at_most(self.accel_mps2 - load_mps2, HILL_SHARE * self.accel_mps2))

    def release(self) -> float:
        """No demand: the driver takes over or hands over without a jerk."""
        self.accel_mps2, self._goal_mps = 0.0, None
        self._load.pause()
        return self._give(0.0)

    def _rate(self, goal: Target, dt_s: float) -> float:
        """v_t' [m/s²]."""
        if self._goal_mps is None:
            self._smooth_mps = goal.speed_mps
        elif abs(goal.speed_mps - self._goal_mps) > self._step_mps:
            self._smooth_mps += goal.speed_mps - self._goal_mps
        self._goal_mps = goal.speed_mps
        rate_mps2 = (goal.speed_mps - self._smooth_mps) / (RATE_S + dt_s)
        self._smooth_mps += dt_s * rate_mps2
        return rate_mps2 if goal.accel_mps2 is None else goal.accel_mps2

    def _observe(self, speed_mps: float | None, dt_s: float) -> None:
        if speed_mps is None:
            self._load.pause()
        elif speed_mps <= self._standstill_mps:
            self._load.standing()
        else:
            self._load.step(self._given_mps2, speed_mps=speed_mps, dt_s=dt_s)

    def _towards(self, wanted_mps2: float, rise_mps2: float, fall_mps2: float) -> None:
        """Move the acceleration towards ``wanted_mps2`` by at most ``rise_mps2`` up or ``fall_mps2`` down."""
        self.accel_mps2 += at_least(at_most(wanted_mps2 - self.accel_mps2, rise_mps2), -fall_mps2)

    def _give(self, demand_mps2: float) -> float:
        self._given_mps2 = within(demand_mps2, self._strongest_mps2)
        return self._given_mps2
