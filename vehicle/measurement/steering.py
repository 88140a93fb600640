"""Wheel angle and yaw rate against each other, the commands, the lock and the speed of the steering.

The bicycle with understeer relates them, ψ' = v·tan δ/(L + K_us·v²). The wheel follows the commands given to it: it
stays within the range of all commands of the time

    W = lateness·(dead time + 4·time constant)

as in the detection of a driver (:mod:`controller.limiter.watches`). Of wheel angle and yaw rate that contradict
each other the one is wrong that the commands contradict, too. A wheel away from the commands with which the yaw
rate agrees stands there: a driver or a fault of the steering moves it, and it is no wrong measurement. Under a
driver the wheel angle is compared with its own past only, and the yaw rate with the wheel angle.

Small movements are compared with the commands over several seconds (:mod:`vehicle.measurement.slope`): the wheel
neither moves against them nor far more than they, and the car does not turn against them. Wind and ruts that turn
the car do not make it seem so, although the controller steers against them: it steers by heading and place, the
integrals of the yaw rate. With ψ' = g·(δ + d) under a disturbance d and δ = -exp(-sT)·(K + K_y·v/s)·ψ after the
delay T of the loop, the slope of ψ'/g over δ at the frequency ω is

    ω²·(K_y·v·cos ωT + K·ω·sin ωT)/(g·(K_y²·v² + K²·ω²)) > 0 for ωT < π/2.

It has no upper bound, so that a yaw rate that is too large is left to the other comparisons.
"""

import math

from trepid.car.vehicle import Vehicle
from vehicle.measurement.doubt import Doubt, Standing, Window
from vehicle.measurement.settings import MeasurementSettings, SlopeSettings
from vehicle.measurement.slope import Slope

TIME_CONSTANTS = 4.0
LONGEST_S = 0.2  # a longer gap between two values allows any step
BEGIN_S = 1.0  # of motion, until the mean difference is known


def build_slope(vehicle: Vehicle, settings: SlopeSettings) -> Slope:
    """The comparison of small movements of the steering of ``vehicle``."""
    filter_s = max(vehicle.steering_delay_s + vehicle.steering_lag_s, settings.filter_s)
    return Slope(settings, filter_s=filter_s)


class Bicycle:
    """The steady bicycle: yaw rate of a wheel angle and back."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._length_m = vehicle.wheelbase_m
        self.gradient = vehicle.understeer_gradient_rad_per_mps2

    def yaw_rate_radps(self, wheel_rad: float, speed_mps: float) -> float:
        """ψ' = v·tan δ/(L + K_us·v²) [rad/s]."""
        return math.tan(wheel_rad) * self.per_rad(speed_mps)

    def per_rad(self, speed_mps: float) -> float:
        """∂ψ'/∂tan δ [1/s]; at 0.95 of the critical speed of an oversteering car and beyond, that of there."""
        least_m = 0.1 * self._length_m
        return speed_mps / max(self._length_m + self.gradient * speed_mps**2, least_m)

    def wheel_rad(self, yaw_rate_radps: float, speed_mps: float) -> float:
        """δ = atan(L·ψ'/v) + K_us·v·ψ' [rad]; the speed must not be 0."""
        kinematic_rad = math.atan(self._length_m * yaw_rate_radps / speed_mps)
        return kinematic_rad + self.gradient * speed_mps * yaw_rate_radps


class WheelCheck:
    """Call ``step`` with every state."""

    def __init__(self, vehicle: Vehicle, settings: MeasurementSettings) -> None:
        self._limits, self._moving_mps = settings.wheel_angle, settings.doubt.moving_mps
        self._rate_radps = self._limits.rate_share * vehicle.max_road_wheel_rate_radps
        late_s = vehicle.steering_delay_s + TIME_CONSTANTS * vehicle.steering_lag_s
        self._commands = Window(self._limits.lateness * late_s)
        self._follow_s = vehicle.steering_delay_s + vehicle.steering_lag_s
        self._slope, self._slopes = build_slope(vehicle, settings.slope), settings.slope
        self._bicycle = Bicycle(vehicle)
        self._noise_radps = settings.yaw_rate.noise_radps
        self.doubt = Doubt(settings.doubt)
        self._standing = Standing(settings.stands, settings.stands.wheel_angle_rad)
        self._last: tuple[float, float] | None = None  # time and value of the last trusted measurement
        self._explained_s: float | None = None  # last time at which the commands explained the measurement
        self.commanded_rad: float | None = None
        """The wheel angle by the commands; None before the first."""

    def command(self, angle_rad: float | None, dt_s: float, *, now_s: float) -> None:
        """Add the command that was given to the car; None: there was none."""
        if angle_rad is None:
            return
        self._commands.add(angle_rad, now_s=now_s)
        before_rad = angle_rad if self.commanded_rad is None else self.commanded_rad
        share = dt_s / (self._follow_s + dt_s) if dt_s else 0.0
        self.commanded_rad = before_rad + share * (angle_rad - before_rad)

    def step(
        self,
        angle_rad: float | None,
        yaw_rate_radps: float | None,
        speed_mps: float | None,
        dt_s: float,
        *,
        driver: bool,
        now_s: float,
    ) -> bool:
        """Whether ``angle_rad`` holds; ``speed_mps`` is the expected speed, ``yaw_rate_radps`` as measured."""
        if angle_rad is None:
            self._last = self._explained_s = None
            self._slope.clear()
            self.doubt.step("", now_s=now_s)
            return False
        reason = self._step_reason(angle_rad, now_s)
        if self.commanded_rad is not None and speed_mps is not None and not driver:
            moving = speed_mps > self._moving_mps
            changed_rad = self._standing.step(angle_rad, self.commanded_rad, moving=moving, now_s=now_s)
            if not reason and changed_rad:
                reason = (
                    f"stands at {angle_rad:z.4f} rad while the commands change it by {changed_rad:z.4f} rad"
                )
            reason = reason or self._command_reason(angle_rad, yaw_rate_radps, speed_mps, now_s)
            reason = reason or self._slope_reason(angle_rad, yaw_rate_radps, speed_mps, dt_s)
        else:
            self._explained_s = now_s
            self._slope.clear()
        doubted = self.doubt.step(reason, now_s=now_s)
        if not doubted:
            self._last = now_s, angle_rad
        return not doubted

    def _step_reason(self, angle_rad: float, now_s: float) -> str:
        """A step that no steering makes."""
        if self._last is None:
            return ""
        gap_s, before_rad = now_s - self._last[0], self._last[1]
        if self.doubt.reason or gap_s > LONGEST_S:
            return ""
        period_s = gap_s + 0.01  # a report may be one period of the process older than it seems
        if abs(angle_rad - before_rad) <= self._rate_radps * period_s + self._limits.step_rad:
            return ""
        return f"jumps from {before_rad:z.3f} to {angle_rad:z.3f} rad"

    def _command_reason(
        self, angle_rad: float, yaw_rate_radps: float | None, speed_mps: float, now_s: float
    ) -> str:
        """A wheel away from all recent commands, where the yaw rate agrees with the commands and not with it."""
        beyond_rad = abs(self._commands.beyond(angle_rad))
        explained = beyond_rad <= self._limits.command_rad
        if not explained and self.doubt.reason:  # also of a car that stands now
            return self.doubt.reason
        if explained or speed_mps <= self._moving_mps:
            self._explained_s = now_s
            return ""
        since_s = now_s if self._explained_s is None else self._explained_s
        if yaw_rate_radps is None or now_s - since_s < self._limits.command_after_s:
            return ""
        assert self.commanded_rad is not None
        turned = [self._bicycle.yaw_rate_radps(rad, speed_mps) for rad in (angle_rad, self.commanded_rad)]
        off_measured, off_commanded = (abs(yaw_rate_radps - rate) for rate in turned)
        if off_measured <= off_commanded + self._noise_radps:
            return ""
        return f"{angle_rad:z.3f} rad is {beyond_rad:z.3f} rad from all commands, and the car turns by the commands"

    def _slope_reason(
        self, angle_rad: float, yaw_rate_radps: float | None, speed_mps: float, dt_s: float
    ) -> str:
        """A wheel that moves against the commands, or far more than they, where the yaw rate follows them.

        Values of a standing car change nothing.
        """
        slope = self._slope
        if yaw_rate_radps is None:
            slope.clear()
            return ""
        assert self.commanded_rad is not None
        if speed_mps > self._moving_mps:
            turned_rad = self._bicycle.wheel_rad(yaw_rate_radps, speed_mps)
            slope.step(self.commanded_rad, angle_rad, turned_rad, dt_s)
        least, most = slope.interval or (0.0, 0.0)
        if least <= self._slopes.most and most >= 0.0:
            return ""
        return (
            f"moves {least:.1f} to {most:.1f} times as far as the commands, and the car turns by the commands"
        )


class YawCheck:
    """Call ``step`` with every state."""

    def __init__(self, vehicle: Vehicle, settings: MeasurementSettings) -> None:
        self._limits, self._moving_mps = settings.yaw_rate, settings.doubt.moving_mps
        self._bicycle = Bicycle(vehicle)
        self.doubt = Doubt(settings.doubt)
        self._standing = Standing(settings.stands, settings.stands.yaw_rate_radps)
        self._standstill_mps = vehicle.standstill_mps
        self._wheels = Window(self._limits.lag_s)
        self._slope, self._slopes = build_slope(vehicle, settings.slope), settings.slope
        self._usual_radps: float | None = None  # measured less computed, of the last filter_s
        # Wheel angle by the yaw rate less the measured one: its mean, and the time of motion of that mean.
        self._offset_rad = self._moved_s = 0.0

    def step(
        self,
        yaw_rate_radps: float | None,
        wheel_rad: float | None,
        speed_mps: float | None,
        dt_s: float,
        *,
        commanded_rad: float | None,
        now_s: float,
    ) -> bool:
        """Whether ``yaw_rate_radps`` holds; wheel angle and speed: the trusted ones, or those by the commands.

        ``commanded_rad`` is the wheel angle by the commands; None under a driver.
        """
        if wheel_rad is not None:
            self._wheels.add(wheel_rad, now_s=now_s)
        if yaw_rate_radps is None:
            self._usual_radps = None
            self._slope.clear()
            self.doubt.step("", now_s=now_s)
            return False
        if wheel_rad is None or speed_mps is None:
            self.doubt.step("", now_s=now_s)
            return not self.doubt.reason
        turned_radps = self._bicycle.yaw_rate_radps(wheel_rad, speed_mps)
        off_radps = yaw_rate_radps - turned_radps
        moving = speed_mps > self._moving_mps
        changed_radps = self._standing.step(yaw_rate_radps, turned_radps, moving=moving, now_s=now_s)
        reason = ""
        if changed_radps:
            reason = (
                f"stands at {yaw_rate_radps:z.3f} rad/s while wheels and speed change it by"
                f" {changed_radps:z.3f} rad/s"
            )
        reason = reason or self._level_reason(yaw_rate_radps, speed_mps, dt_s, moving=moving)
        reason = reason or self._step_reason(yaw_rate_radps, turned_radps, speed_mps)
        reason = reason or self._slope_reason(yaw_rate_radps, wheel_rad, commanded_rad, speed_mps, dt_s)
        doubted = self.doubt.step(reason, now_s=now_s)
        if self._usual_radps is None or (not moving and not doubted):
            self._usual_radps = off_radps
        if not doubted:
            share = dt_s / (self._limits.filter_s + dt_s) if dt_s else 0.0
            self._usual_radps += share * (off_radps - self._usual_radps)
        return not doubted

    def _level_reason(self, yaw_rate_radps: float, speed_mps: float, dt_s: float, *, moving: bool) -> str:
        """A standing car that yaws, or a yaw rate far from all wheel angles of the last ``lag_s``.

        The wheel angles are those with the usual difference, the mean of ``offset_s`` within ``offset_rad``: an
        offset of the steering, the bank of the road.
        """
        limits = self._limits
        if speed_mps <= self._standstill_mps:
            still = abs(yaw_rate_radps) <= limits.standing_radps
            return "" if still else f"{yaw_rate_radps:z.3f} rad/s of a standing car"
        if not moving:
            return ""
        needed_rad = self._bicycle.wheel_rad(yaw_rate_radps, speed_mps)
        lateral_mps2 = abs(speed_mps * yaw_rate_radps)
        allowed_rad = (
            limits.wheel_rad
            + limits.wheel_share * abs(needed_rad)
            + limits.understeer_share * abs(self._bicycle.gradient) * lateral_mps2
            + limits.noise_radps / max(self._bicycle.per_rad(speed_mps), 1e-3)
        )
        if self._moved_s < BEGIN_S:  # the usual difference is not known yet
            allowed_rad += limits.offset_rad
        beyond_rad = self._wheels.beyond(needed_rad - self._offset_rad)
        if abs(beyond_rad) <= allowed_rad:
            self._learn_offset(beyond_rad, dt_s)
            return ""
        low_rad, high_rad = self._wheels.ends or (math.nan, math.nan)
        return (
            f"{yaw_rate_radps:z.3f} rad/s at {speed_mps:z.1f} m/s needs wheels at {needed_rad:z.3f} rad, and they"
            f" stand at {low_rad:z.3f} to {high_rad:z.3f} rad"
        )

    def _learn_offset(self, beyond_rad: float, dt_s: float) -> None:
        """Move the usual difference towards the present one: a mean at first, then a filter of ``offset_s``."""
        limits = self._limits
        self._moved_s = min(self._moved_s + dt_s, limits.offset_s)
        share = dt_s / self._moved_s if self._moved_s > 0.0 else 0.0
        moved_rad = self._offset_rad + share * beyond_rad
        self._offset_rad = max(-limits.offset_rad, min(limits.offset_rad, moved_rad))

    def _step_reason(self, yaw_rate_radps: float, turned_radps: float, speed_mps: float) -> str:
        """A change that wheel angle and speed do not give."""
        if self._usual_radps is None:
            return ""
        limits = self._limits
        change_radps = yaw_rate_radps - turned_radps - self._usual_radps
        allowed_radps = limits.step_radps + limits.step_rad * self._bicycle.per_rad(speed_mps)
        if abs(change_radps) <= allowed_radps:
            return ""
        return f"{yaw_rate_radps:z.3f} rad/s, and wheels and speed turn the car by {turned_radps:z.3f} rad/s"

    def _slope_reason(
        self,
        yaw_rate_radps: float,
        wheel_rad: float,
        commanded_rad: float | None,
        speed_mps: float,
        dt_s: float,
    ) -> str:
        """A car that seems to turn against the commands while the wheel follows them.

        Values of a standing car change nothing.
        """
        slope = self._slope
        if commanded_rad is None:
            slope.clear()
            return ""
        if speed_mps > self._moving_mps:
            turned_rad = self._bicycle.wheel_rad(yaw_rate_radps, speed_mps)
            slope.step(commanded_rad, turned_rad, wheel_rad, dt_s)
        least, most = slope.interval or (0.0, 0.0)
        return f"turns {least:.1f} to {most:.1f} times as far as the wheel" if most < 0.0 else ""
