"""The limiter: from command and vehicle state to the output for the actuator.

Steering. The angle must lie in three intervals, in falling priority:

1. range of the wheel: ±max angle, and at most rate·dt from the last angle,
2. lateral acceleration: |κ|·v² ≤ 3 m/s², at the speed of the car when the wheel has followed, less the measured
   excess of the yaw rate,
3. lateral jerk: d(κ·v²)/dt = v²·κ' + 2·v·a·κ within ±5 m/s³. The part by changes of speed, measured and commanded,
   reduces the part left for the wheel; a brake may use no more than the whole, and together with the bend no more
   grip than the hardest brake alone.

``narrow(outer, inner)`` is their intersection or, when they are apart, the point of ``outer`` nearest to ``inner``.
It maps two non-empty intervals to a non-empty one inside ``outer``. The first interval contains the last angle,
which was itself within ± max angle; the second contains straight on; the third contains the last angle. So the
feasible interval is never empty, and holding the wheel is feasible unless it breaks the second. When limits
conflict, as at a speed too high for the bend, the wheel moves towards less |κ| at its full rate, acceleration has
priority over jerk, and the brake is applied.

Acceleration. Bounded by the drive and brake limits. No drive and at least the comfort brake when the frame
behind the command is old, when the next command is late or commands are too rare, when the demanded or driven bend
is too tight for the speed, when the state of the vehicle is missing, and before the first command. When commands or
states are missing for longer than their timeouts, or a command is not finite: a stop, latched until standstill.
Without a command the last curvature is held; later commands steer the stop but do not end it. A speed or wheel
angle that is doubted (``VehicleState.doubted``) costs the drive: commands go on steering within the limits of the
last speed, which the brake lowers, and without a speed the stop follows after the timeout of states. Where the
acceleration is less than demanded, the target speed is at most that of ``SOON_S`` later: a car that follows the
target speed brakes too.

The driver. While the driver has the car, the output is the measured angle, and drive and brakes fade to zero; after
the hand-back, at the measured angle, rate and jerk rise to their limits.

ISO 11270:2014 (3 m/s², 5 m/s³); UN R157 5.3 (4 m/s², ends at standstill or when the driver takes over); UN R79
5.1 (the driver overrides at once).
"""

from dataclasses import replace
from math import isnan, nan, sqrt
from pathlib import Path
from typing import NamedTuple

from controller.limiter.inputs import Arrivals, SeenState, fresh, is_finite, plausible_state
from controller.limiter.limits import Interval, Limits, clip, inside, narrow
from controller.limiter.turn import Excess, SteadyTurn
from controller.limiter.watches import DriverWatch, SaturationWatch
from trepid.car.vehicle import Vehicle
from trepid.causes import NO_COMMAND, NO_SPEED
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState

SLOWEST_MPS = 0.1  # lower bound of v, which keeps a/v² finite
LEAST = 1e-9  # lower bound of other divisors
SOON_S = 1.0  # response time of a speed controller


def build(vehicle: Vehicle | None = None, limits_file: Path | None = None) -> "Limiter":
    """Limiter of ``vehicle`` (default: ``config/vehicle.yaml``). Raises InputError on a bad file."""
    vehicle = vehicle or load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return Limiter(vehicle, load(limits_file or CONFIG_DIR / "limiter.yaml", Limits))


class Wheel(NamedTuple):
    """Output angle, and the speed of the car at that time."""

    angle_rad: float
    speed_mps: float


UNSEEN = Wheel(0.0, 0.0)  # the output before the first measured wheel angle


class Limiter:
    """Call ``step`` in every cycle of the actuator (100 Hz), with or without new inputs."""

    def __init__(self, vehicle: Vehicle, limits: Limits) -> None:
        self._vehicle, self._limits, self.standstill_mps = vehicle, limits, vehicle.standstill_mps
        self._limit_rad = vehicle.max_road_wheel_angle_rad
        self._middle_m = vehicle.wheelbase_m / 2.0
        self._late_s = vehicle.steering_delay_s + vehicle.steering_lag_s
        self._lateral_mps2 = limits.lateral_accel_share * limits.lateral_accel_mps2
        self._jerk_mps3 = limits.lateral_jerk_share * limits.lateral_jerk_mps3
        self._turn = SteadyTurn(vehicle)
        self._excess = Excess(self._turn, limits)
        self._arrivals, self._driver = Arrivals(limits), DriverWatch(vehicle, limits)
        self._saturation = SaturationWatch(vehicle, limits)
        # Times of the first step, the last step and the last plausible state; initially that of the first step.
        self._start_s = self._now_s = self._state_s = nan
        self.stopping = False
        """The limiter stops the car."""
        self.stop_reason = ""  # one of OWN_STOPS; "": the limiter does not stop the car of its own accord
        self.handed_over = False
        """The driver has the car."""
        self._ours_s = 0.0  # time since the hand-back
        self._wheel = UNSEEN  # last output
        self._seen_mps: float | None = None  # last measured speed
        self._accel_mps2 = 0.0  # last output
        self._gaining_mps2 = 0.0  # acceleration of the car by the drive

    @property
    def is_saturated(self) -> bool:
        """Whether the steering demand is beyond the limits for longer."""
        return self._saturation.is_saturated

    @property
    def has_seen_wheel(self) -> bool:
        """Whether a wheel angle was measured; before it the output is straight on, wherever the wheels stand."""
        return self._wheel is not UNSEEN

    def report(self, state: VehicleState) -> VehicleState:
        """``state`` with driver override and saturation as of the last step."""
        return replace(state, driver_override=self.handed_over, saturated=self.is_saturated)

    def step(
        self, command: Command | None, received_s: float | None, state: VehicleState | None, *, now_s: float
    ) -> Command:
        """The output for the actuator at ``now_s``; ``received_s``: arrival of ``command``."""
        dt_s = self._elapsed_time_s(now_s)
        sound = command if command is not None and is_finite(command) else None
        frame_s = None if sound is None else sound.t_s
        seen = plausible_state(state, now_s, self._limits, last_mps=self._seen_mps)
        seldom = self._arrivals.too_seldom(received_s, now_s)
        self.handed_over = seen is not None and self._is_driven_by_hand(seen)
        if seen is not None and self.handed_over:
            return self._hand_over(seen, frame_s, dt_s)
        timeout_s = self._limits.command_timeout_s
        usable = sound if fresh(received_s, now_s, timeout_s, self._limits) else None
        waiting = command is None and fresh(self._start_s, now_s, timeout_s, self._limits)
        self._judge(seen, lost=usable is None and not waiting, missing=command is not None and usable is None)
        calm = fresh(received_s, now_s, self._limits.command_late_s, self._limits) and not seldom
        calm = calm and seen is not None and seen.measures_speed and seen.wheel_rad is not None
        if seen is None:
            accel_mps2 = self._demand(usable, -self._limits.comfort_decel_mps2)
        else:
            accel_mps2 = self._steer(usable, seen, dt_s, calm=calm)
        goal_mps = 0.0 if usable is None or self.stopping else _goal(usable, seen, accel_mps2)
        return self._actuator_command(frame_s, goal_mps, accel_mps2, dt_s)

    def _elapsed_time_s(self, now_s: float) -> float:
        """Time since the last step; at most ``max_step_s``, so that a pause opens no limit wide."""
        if isnan(self._start_s):
            self._start_s = self._now_s = self._state_s = now_s
        last_s, self._now_s = self._now_s, now_s
        return clip(now_s - last_s, (0.0, self._limits.max_step_s))

    def _is_driven_by_hand(self, seen: SeenState) -> bool:
        """Whether the driver has the car; the first measured angle becomes the output."""
        if seen.measures_speed:
            self._state_s, self._seen_mps = self._now_s, seen.speed_mps
        if self._wheel is UNSEEN:
            self._follow(seen)
        return self._driver.step(seen, self._now_s)

    def _hand_over(self, seen: SeenState, frame_s: float | None, dt_s: float) -> Command:
        """The measured angle as output; drive and brakes fade."""
        self.stopping, self.stop_reason = False, ""
        self._ours_s = 0.0
        self._follow(seen)
        self._saturation.rest(dt_s)
        reach_mps2 = self._limits.override.fade_mps3 * dt_s
        accel_mps2 = clip(0.0, (self._accel_mps2 - reach_mps2, self._accel_mps2 + reach_mps2))
        return self._actuator_command(frame_s, seen.speed_mps, accel_mps2, dt_s)

    def _judge(self, seen: SeenState | None, *, lost: bool, missing: bool) -> None:
        """Begin the stop when commands (after earlier ones: ``missing``) or states are lost; standstill ends it."""
        blind = self._now_s - self._state_s > self._limits.state_timeout_s
        if lost or blind:
            self.stopping = True
            self.stop_reason = NO_COMMAND if missing else NO_SPEED if blind else self.stop_reason
        elif seen is not None and seen.measures_speed and seen.speed_mps <= self.standstill_mps:
            self.stopping, self.stop_reason = False, ""

    def _demand(self, command: Command | None, highest_mps2: float) -> float:
        """Acceleration demand [m/s²], at most ``highest_mps2``."""
        limits = self._limits
        if self.stopping:
            return -limits.stop_decel_mps2
        if command is None:
            return -limits.comfort_decel_mps2
        return clip(command.accel_mps2, (-limits.max_decel_mps2, highest_mps2))

    def _highest(self, command: Command | None, *, calm: bool) -> float:
        """Upper limit of the acceleration [m/s²]: drive only for a calm car with a command on a fresh frame."""
        limits = self._limits
        driven = (
            calm and command is not None and fresh(command.t_s, self._now_s, limits.frame_timeout_s, limits)
        )
        return limits.max_accel_mps2 if driven else -limits.comfort_decel_mps2

    def _steer(self, command: Command | None, seen: SeenState, dt_s: float, *, calm: bool) -> float:
        """Move the wheel towards the demand within the limits; returns the acceleration demand."""
        last_rad, limit_rad, speed_mps = self._wheel.angle_rad, self._limit_rad, seen.speed_mps
        wanted_rad, rate_radps = self._wheel_demand(command, speed_mps)
        held_1pm = self._turn.curvature_1pm(last_rad, speed_mps)
        gentle = self._gentle(speed_mps, 0.0)
        calm = calm and inside(wanted_rad, gentle) and inside(last_rad, gentle)
        demand_mps2 = self._demand(command, self._highest(command, calm=calm))
        accel_mps2 = self._within_bend(demand_mps2, held_1pm, speed_mps)
        ahead_mps = speed_mps + max(accel_mps2, self._gaining_mps2, 0.0) * self._late_s
        gentle = self._gentle(ahead_mps, self._excess.step(seen, dt_s))

        self._ours_s += dt_s
        share = min(self._ours_s / self._limits.override.fade_in_s, 1.0)
        reach_rad = rate_radps * dt_s
        possible = narrow((-limit_rad, limit_rad), (last_rad - reach_rad, last_rad + reach_rad))
        smooth = narrow(
            self._smooth(held_1pm, accel_mps2, speed_mps, dt_s, share),
            (last_rad - share * reach_rad, last_rad + share * reach_rad),
        )
        angle_rad = clip(wanted_rad, narrow(narrow(possible, gentle), smooth))
        self._remember(angle_rad, speed_mps)
        self._saturation.step(wanted_rad, angle_rad, speed_mps, dt_s)
        return accel_mps2

    def _wheel_demand(self, command: Command | None, speed_mps: float) -> tuple[float, float]:
        """Demanded angle [rad] and rate [rad/s] of the wheel; without a command the last curvature."""
        rate_radps = self._vehicle.max_road_wheel_rate_radps
        if command is None:
            return self._turn.angle_rad(self._turn.curvature_1pm(*self._wheel), speed_mps), rate_radps
        if command.road_wheel_rate_radps > 0.0:
            rate_radps = min(command.road_wheel_rate_radps, rate_radps)
        return command.road_wheel_angle_rad, rate_radps

    def _gentle(self, speed_mps: float, excess_mps2: float) -> Interval:
        """Angles [rad] within the limit of lateral acceleration, of which ``excess_mps2`` takes its part."""
        per_mps2 = 1.0 / max(speed_mps, SLOWEST_MPS) ** 2
        left_1pm = per_mps2 * (self._lateral_mps2 - max(excess_mps2, 0.0))
        right_1pm = per_mps2 * (self._lateral_mps2 + min(excess_mps2, 0.0))
        return self._turn.angle_rad(-right_1pm, speed_mps), self._turn.angle_rad(left_1pm, speed_mps)

    def _within_bend(self, accel_mps2: float, held_1pm: float, speed_mps: float) -> float:
        """``accel_mps2`` within the limits of drive and brake in a bend.

        2·v·|a·κ| is within the jerk limit. A brake and κ·v² together, √(a² + (κ·v²)²), use no more grip
        than the hardest brake alone: beyond, the car turns inwards without a steering demand. The comfort brake is
        always allowed. Beyond the limit of lateral acceleration, where braking is urgent, only that limit counts as
        κ·v².
        """
        speed_mps, limits = max(speed_mps, SLOWEST_MPS), self._limits
        lateral_mps2 = min(abs(held_1pm) * speed_mps**2, self._lateral_mps2)
        longest_mps2 = self._bearable_mps3(speed_mps) * speed_mps / (2.0 * max(lateral_mps2, LEAST))
        grip_mps2 = sqrt(max(limits.max_decel_mps2**2 - lateral_mps2**2, limits.comfort_decel_mps2**2))
        return clip(accel_mps2, (-min(longest_mps2, grip_mps2), longest_mps2))

    def _bearable_mps3(self, speed_mps: float) -> float:
        """Largest d(κ·v²)/dt [m/s³].

        In the middle of the car, L/2 before the rear axle, yaw acceleration adds L/(2·v)·d(κ·v²)/dt to κ·v² and
        reduces the jerk limit accordingly, which matters at low speed.
        """
        return self._jerk_mps3 * speed_mps / (speed_mps + self._middle_m)

    def _smooth(
        self, held_1pm: float, accel_mps2: float, speed_mps: float, dt_s: float, share: float
    ) -> Interval:
        """Angles [rad] within ``share`` of the jerk limit less the part by changes of speed."""
        floor_mps = max(speed_mps, SLOWEST_MPS)
        budget_mps2 = share * self._bearable_mps3(floor_mps) * dt_s
        per_mps = 2.0 * speed_mps * held_1pm
        coming_mps2 = per_mps * accel_mps2 * dt_s
        measured_mps2 = per_mps * (speed_mps - self._wheel.speed_mps)
        up_mps2 = max(budget_mps2 - max(coming_mps2, measured_mps2, 0.0), 0.0)
        down_mps2 = max(budget_mps2 + min(coming_mps2, measured_mps2, 0.0), 0.0)
        return (
            self._turn.angle_rad(held_1pm - down_mps2 / floor_mps**2, speed_mps),
            self._turn.angle_rad(held_1pm + up_mps2 / floor_mps**2, speed_mps),
        )

    def _follow(self, seen: SeenState) -> None:
        """Set the last output to the measured wheel angle; one that is not measured stays where it was put."""
        wheel_rad = self._wheel.angle_rad if seen.wheel_rad is None else seen.wheel_rad
        self._remember(clip(wheel_rad, (-self._limit_rad, self._limit_rad)), seen.speed_mps)

    def _remember(self, angle_rad: float, speed_mps: float) -> None:
        """Set the last output."""
        self._wheel = Wheel(angle_rad, speed_mps)
        self._driver.add_demand(angle_rad, self._now_s)

    def _actuator_command(
        self, frame_s: float | None, goal_mps: float, accel_mps2: float, dt_s: float
    ) -> Command:
        """The command for the actuator; the drive follows it with a lag of first order."""
        passed = dt_s / max(self._vehicle.accel_lag_s + dt_s, LEAST)
        self._gaining_mps2 += passed * (accel_mps2 - self._gaining_mps2)
        self._accel_mps2 = accel_mps2
        return Command(
            t_s=frame_s,
            road_wheel_angle_rad=self._wheel.angle_rad,
            speed_mps=goal_mps,
            accel_mps2=accel_mps2,
        )


def _goal(command: Command, seen: SeenState | None, accel_mps2: float) -> float:
    """Target speed [m/s] of ``command`` within ``accel_mps2``, what the limits leave of its acceleration."""
    if accel_mps2 >= command.accel_mps2:
        return command.speed_mps
    soon_mps = 0.0 if seen is None else seen.speed_mps + accel_mps2 * SOON_S
    return max(0.0, min(command.speed_mps, soon_mps))
