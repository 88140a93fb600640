"""The limiter: last word before the actuator. It passes a command on, bounded, or stops the car by itself.

It runs in the vehicle process, shares no code with the controller but the bicycle model, and trusts nothing it is
sent.

Steering. The angle must lie in three intervals, the first being the hardest:

1. what the wheel can do: ±max angle, and not further from the last angle than rate·dt,
2. lateral acceleration: |κ|·v² ≤ 3 m/s²,
3. lateral jerk: |κ·v² - (κ·v²)_last| ≤ 5 m/s³·dt. A difference of accelerations and not of curvatures, so that
   the part 2·v·a·κ of speeding up or slowing down in a bend is in it.

``_narrow(outer, inner)`` is their intersection or, when they are apart, the point of ``outer`` nearest to
``inner``. It maps two non-empty intervals to a non-empty one inside ``outer``. The first interval is not empty (it
contains the last angle, which was itself within ± max angle), 2 and 3 are not empty (their half-widths are not
negative), so the feasible interval never is. When limits conflict, as at a speed too high for the bend, the wheel
goes towards less |κ| as fast as it can, acceleration comes before jerk, and the brake is applied.

Acceleration. Bounded by the drive and brake limits. No drive and at least the comfort brake when the frame behind
the command is old, when the bend asked for or driven is too tight for the speed, when the vehicle's state is
missing, and until the first command comes. When commands or states stay away longer than their timeouts, or a
command is not finite: a stop, latched until standstill. Without a command the last curvature is held; commands
that come again steer the stop but do not end it.

ISO 11270:2014 (3 m/s², 5 m/s³); UN R157 5.3 (4 m/s², ends at standstill or when the driver takes over); UN R79
5.1 (the driver overrides at once).
"""

import math
from math import isfinite
from pathlib import Path
from typing import Annotated

from pydantic import Field

from controller.bicycle import angle_from_curvature, critical_speed, curvature_from_angle
from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import Command, VehicleState
from trepid.vehicle import Positive, Vehicle

Interval = tuple[float, float]

_MIN_SPEED2_M2PS2 = 0.01  # below 0.1 m/s any curvature is gentle; keeps a/v² finite
_STABLE_SHARE = 0.95  # of an oversteering car's critical speed, up to which angle rises with curvature


class Limits(Settings):
    """``config/limiter.yaml``."""

    lateral_accel_mps2: Positive
    lateral_jerk_mps3: Positive
    max_accel_mps2: Positive
    max_decel_mps2: Annotated[float, Field(gt=0, le=4.0)]
    comfort_decel_mps2: Positive
    stop_decel_mps2: Annotated[float, Field(gt=0, le=4.0)]
    command_timeout_s: Positive
    state_timeout_s: Positive
    frame_timeout_s: Positive
    early_s: Positive
    max_step_s: Positive
    max_speed_mps: Positive
    max_angle_rad: Annotated[float, Field(gt=0, lt=math.pi / 2)]
    standstill_mps: Positive


def build(vehicle: Vehicle | None = None, limits_file: Path | None = None) -> "Limiter":
    """Limiter of ``vehicle`` (default: ``config/vehicle.yaml``). Raises InputError on a bad file."""
    vehicle = vehicle or load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return Limiter(vehicle, load(limits_file or CONFIG_DIR / "limiter.yaml", Limits))


class Limiter:
    """``step`` it in every cycle of the actuator (100 Hz), whether or not anything came."""

    def __init__(self, vehicle: Vehicle, limits: Limits) -> None:
        self._vehicle = vehicle
        self._limits = limits
        self._stable_mps = _STABLE_SHARE * critical_speed(vehicle)
        self._start_s: float | None = None  # time of the first step
        self._now_s = 0.0  # time of the last step
        self._state_s = 0.0  # when the state was last good; the first step counts as such
        self._stopping = False
        self._angle_rad: float | None = None  # last output; None until a wheel angle was seen
        self._curvature_1pm = 0.0  # of the last output
        self._lateral_mps2 = 0.0  # of the last output: κ·v²

    @property
    def stopping(self) -> bool:
        """True while the limiter stops the car by itself."""
        return self._stopping

    def step(
        self, command: Command | None, received_s: float | None, state: VehicleState | None, *, now_s: float
    ) -> Command:
        """What goes to the actuator at ``now_s``; ``received_s`` is when ``command`` arrived."""
        dt_s = self._elapsed(now_s)
        finite = command is not None and _is_finite(command)
        frame_s = command.t_s if command is not None and finite else None
        speed_mps = self._speed(state, now_s)
        if state is not None and speed_mps is not None and state.driver_override:
            self._stopping = False
            angle_rad = self._follow_wheel(state, speed_mps)
            return _command(frame_s, angle_rad, speed_mps, 0.0)
        command = self._judge(command, received_s, speed_mps, now_s, finite=finite)
        if state is None or speed_mps is None:
            angle_rad, too_tight = self._angle_rad or 0.0, False
        else:
            if self._angle_rad is None:
                self._follow_wheel(state, speed_mps)
            angle_rad, too_tight = self._steer(command, speed_mps, dt_s)
        accel_mps2 = self._accel(command, now_s, calm=speed_mps is not None and not too_tight)
        goal_mps = 0.0 if command is None or self._stopping else command.speed_mps
        return _command(frame_s, angle_rad, goal_mps, accel_mps2)

    def _elapsed(self, now_s: float) -> float:
        """Time since the last step; a pause counts as ``max_step_s``, so that no limit opens wide after it."""
        if self._start_s is None:
            self._start_s = self._now_s = self._state_s = now_s
        dt_s, longest_s = now_s - self._now_s, self._limits.max_step_s
        self._now_s = now_s
        if not dt_s > 0.0:
            return 0.0
        return dt_s if dt_s < longest_s else longest_s

    def _speed(self, state: VehicleState | None, now_s: float) -> float | None:
        """|v| [m/s]; None unless the state is fresh and plausible in all that it reports."""
        limits = self._limits
        if state is None or state.speed_mps is None or state.road_wheel_angle_rad is None:
            return None
        plausible = (
            abs(state.speed_mps) <= limits.max_speed_mps
            and abs(state.road_wheel_angle_rad) <= limits.max_angle_rad
            and (state.yaw_rate_radps is None or isfinite(state.yaw_rate_radps))
        )
        if not plausible or not self._fresh(state.t_s, now_s, limits.state_timeout_s):
            return None
        self._state_s = now_s
        return abs(state.speed_mps)

    def _fresh(self, t_s: float | None, now_s: float, timeout_s: float) -> bool:
        """False also for None, NaN and a stamp from the future."""
        return t_s is not None and -self._limits.early_s <= now_s - t_s <= timeout_s

    def _judge(
        self,
        command: Command | None,
        received_s: float | None,
        speed_mps: float | None,
        now_s: float,
        *,
        finite: bool,
    ) -> Command | None:
        """The command if it is good, else None. Begins and ends the stop; a good command steers it."""
        limits = self._limits
        good = finite and self._fresh(received_s, now_s, limits.command_timeout_s)
        waiting = command is None and self._fresh(self._start_s, now_s, limits.command_timeout_s)
        blind = now_s - self._state_s > limits.state_timeout_s
        if blind or not (good or waiting):
            self._stopping = True
        elif speed_mps is not None and speed_mps <= limits.standstill_mps:
            self._stopping = False
        return command if good else None

    def _steer(self, command: Command | None, speed_mps: float, dt_s: float) -> tuple[float, bool]:
        """Feasible angle [rad] nearest to the one asked for, and whether the bend is too tight for the speed."""
        limits = self._limits
        rate = self._vehicle.max_road_wheel_rate_radps
        if command is None:
            wanted_rad = angle_from_curvature(
                self._curvature_1pm, speed_mps=self._modelled(speed_mps), vehicle=self._vehicle
            )
        else:
            wanted_rad = command.road_wheel_angle_rad
            if 0.0 < command.road_wheel_rate_radps < rate:
                rate = command.road_wheel_rate_radps
        possible = self._possible(rate * dt_s)
        gentle = self._angles(0.0, limits.lateral_accel_mps2, speed_mps)
        smooth = self._angles(self._lateral_mps2, limits.lateral_jerk_mps3 * dt_s, speed_mps)
        angle_rad = _clip(wanted_rad, _narrow(_narrow(possible, gentle), smooth))
        self._remember(angle_rad, speed_mps)
        return angle_rad, not (_inside(wanted_rad, gentle) and _inside(angle_rad, gentle))

    def _possible(self, reach_rad: float) -> Interval:
        """Angles that the wheel can be asked for ``reach_rad`` away from the last one; contains that one."""
        limit_rad, last_rad = self._vehicle.max_road_wheel_angle_rad, self._angle_rad or 0.0
        low_rad, high_rad = last_rad - reach_rad, last_rad + reach_rad
        return (
            low_rad if low_rad > -limit_rad else -limit_rad,
            high_rad if high_rad < limit_rad else limit_rad,
        )

    def _angles(self, centre_mps2: float, reach_mps2: float, speed_mps: float) -> Interval:
        """Angles δ(κ), which rise in κ, whose lateral acceleration is within ``centre`` ± ``reach``."""
        speed2 = speed_mps * speed_mps
        speed2 = speed2 if speed2 > _MIN_SPEED2_M2PS2 else _MIN_SPEED2_M2PS2
        low, high = (centre_mps2 - reach_mps2) / speed2, (centre_mps2 + reach_mps2) / speed2
        model_mps = self._modelled(speed_mps)
        return (
            angle_from_curvature(low, speed_mps=model_mps, vehicle=self._vehicle),
            angle_from_curvature(high, speed_mps=model_mps, vehicle=self._vehicle),
        )

    def _modelled(self, speed_mps: float) -> float:
        """The speed up to which the bicycle model is believed."""
        return speed_mps if speed_mps < self._stable_mps else self._stable_mps

    def _follow_wheel(self, state: VehicleState, speed_mps: float) -> float:
        """Take the measured wheel angle [rad] for the last output."""
        limit_rad = self._vehicle.max_road_wheel_angle_rad
        angle_rad = _clip(state.road_wheel_angle_rad or 0.0, (-limit_rad, limit_rad))
        self._remember(angle_rad, speed_mps)
        return angle_rad

    def _remember(self, angle_rad: float, speed_mps: float) -> None:
        curvature_1pm = curvature_from_angle(
            angle_rad, speed_mps=self._modelled(speed_mps), vehicle=self._vehicle
        )
        if curvature_1pm is None:  # oversteer, no steady turn: the true one is tighter than the kinematic one
            curvature_1pm = math.tan(angle_rad) / self._vehicle.wheelbase_m
        self._angle_rad = angle_rad
        self._curvature_1pm = curvature_1pm
        self._lateral_mps2 = curvature_1pm * speed_mps * speed_mps

    def _accel(self, command: Command | None, now_s: float, *, calm: bool) -> float:
        """Acceleration [m/s²] within the limits; only a calm car with a command on a fresh frame may be driven."""
        limits = self._limits
        if self._stopping:
            return -limits.stop_decel_mps2
        if command is None:
            return -limits.comfort_decel_mps2
        driven = calm and self._fresh(command.t_s, now_s, limits.frame_timeout_s)
        highest = limits.max_accel_mps2 if driven else -limits.comfort_decel_mps2
        return _clip(command.accel_mps2, (-limits.max_decel_mps2, highest))


def _command(frame_s: float | None, angle_rad: float, speed_mps: float, accel_mps2: float) -> Command:
    return Command(
        t_s=frame_s,
        road_wheel_angle_rad=angle_rad,
        road_wheel_rate_radps=0.0,
        speed_mps=speed_mps,
        accel_mps2=accel_mps2,
        jerk_mps3=0.0,
    )


def _is_finite(command: Command) -> bool:
    return (
        (command.t_s is None or isfinite(command.t_s))
        and isfinite(command.road_wheel_angle_rad)
        and isfinite(command.road_wheel_rate_radps)
        and isfinite(command.speed_mps)
        and isfinite(command.accel_mps2)
        and isfinite(command.jerk_mps3)
    )


def _narrow(outer: Interval, inner: Interval) -> Interval:
    """The part of ``outer`` in ``inner``, or the point of ``outer`` nearest to it: never empty."""
    return _clip(inner[0], outer), _clip(inner[1], outer)


def _clip(value: float, interval: Interval) -> float:
    low, high = interval
    if not value < high:
        value = high
    return value if value > low else low


def _inside(value: float, interval: Interval) -> bool:
    return interval[0] <= value <= interval[1]
