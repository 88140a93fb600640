"""The speed against tyres and demands.

The expected speed follows the measured one while that is trusted, v̂' = a + (v - v̂)/τ, and the demands alone while
it is doubted; a is the demand behind the lag of the drive, within the limits of drive and brakes. A measurement is
contradicted by

- a step |Δv| beyond what tyres give in the time since the last trusted value,
- a mean acceleration over ``window_s`` beyond all demands of that time and the slack of a grade,
- a car that drives backwards, which nothing demands,
- a value that stands while the demands change the speed.

Under a driver, whose pedals are not known, only the step counts.
"""

import math

from trepid.car.vehicle import Vehicle
from vehicle.measurement.doubt import Doubt, Standing, Window
from vehicle.measurement.settings import MeasurementSettings

FOLLOW_S = 0.3  # τ
EVERY_S = 0.05  # between the entries of the window of the acceleration
LONGEST_S = 0.2  # a longer gap between two values is compared with the expected speed


class SpeedCheck:
    """Call ``step`` with every state."""

    def __init__(self, vehicle: Vehicle, settings: MeasurementSettings) -> None:
        self._vehicle, self._limits = vehicle, settings.speed
        self._moving_mps = settings.doubt.moving_mps
        self.doubt = Doubt(settings.doubt)
        self._standing = Standing(settings.stands, settings.stands.speed_mps)
        self.expected_mps: float | None = None
        """The speed by measurements and demands; None before the first measurement."""
        self._accel_mps2 = 0.0
        self._driven_mps = 0.0  # integral of the demands
        self._last: tuple[float, float] | None = None  # time and value of the last trusted measurement
        self._speeds, self._accels = Window(self._limits.window_s), Window(self._limits.window_s)
        self._due_s = -math.inf  # of the next entry of the windows

    def step(
        self, speed_mps: float | None, demand_mps2: float | None, dt_s: float, *, driver: bool, now_s: float
    ) -> bool:
        """Whether ``speed_mps`` holds; ``demand_mps2`` is the last one given to the car, None before the first."""
        self._drive(0.0 if driver or demand_mps2 is None else demand_mps2, dt_s)
        if speed_mps is None:
            self._last = None
            self._speeds.clear()
            self.doubt.step("", now_s=now_s)
            return False
        free = driver or demand_mps2 is None
        reason = self._contradiction(speed_mps, free=free, now_s=now_s)
        doubted = self.doubt.step(reason, now_s=now_s)
        if not doubted:
            self._follow(speed_mps, dt_s, now_s)
        return not doubted

    def _drive(self, demand_mps2: float, dt_s: float) -> None:
        """Move the expected speed by the demand."""
        vehicle = self._vehicle
        demand_mps2 = max(-vehicle.max_decel_mps2, min(vehicle.max_accel_mps2, demand_mps2))
        self._accel_mps2 += (
            dt_s / (vehicle.accel_lag_s + dt_s) * (demand_mps2 - self._accel_mps2) if dt_s else 0.0
        )
        self._driven_mps += self._accel_mps2 * dt_s
        if self.expected_mps is not None:
            self.expected_mps = max(0.0, self.expected_mps + self._accel_mps2 * dt_s)

    def _follow(self, speed_mps: float, dt_s: float, now_s: float) -> None:
        """Take over a trusted speed."""
        expected_mps = speed_mps if self.expected_mps is None else self.expected_mps
        share = 1.0 if self._last is None else dt_s / (FOLLOW_S + dt_s)
        self.expected_mps = expected_mps + share * (speed_mps - expected_mps)
        self._last = now_s, speed_mps
        if now_s >= self._due_s:
            self._due_s = now_s + EVERY_S
            self._speeds.add(speed_mps, now_s=now_s)
            self._accels.add(self._accel_mps2, now_s=now_s)

    def _contradiction(self, speed_mps: float, *, free: bool, now_s: float) -> str:
        """Why ``speed_mps`` cannot be; "" where it can. ``free``: the demands do not tell the motion."""
        expected_mps, limits = self.expected_mps, self._limits
        if expected_mps is None:
            return ""
        moving = max(abs(speed_mps), expected_mps) > self._moving_mps
        changed_mps = self._standing.step(
            speed_mps, self._driven_mps, moving=moving and not free, now_s=now_s
        )
        reason = self._step_reason(speed_mps, expected_mps, free=free, now_s=now_s)
        if not reason and not free:
            if speed_mps < -limits.reverse_mps:
                reason = f"{speed_mps:z.2f} m/s is backwards"
            elif changed_mps:
                reason = (
                    f"stands at {speed_mps:z.2f} m/s while the demands change it by {changed_mps:z.2f} m/s"
                )
            else:
                reason = self._accel_reason(speed_mps, now_s)
        return reason

    def _step_reason(self, speed_mps: float, expected_mps: float, *, free: bool, now_s: float) -> str:
        limits = self._limits
        if self.doubt.reason:  # compared with the demands until it returns
            off_mps = abs(speed_mps - expected_mps)
            known = free or off_mps <= max(limits.return_mps, limits.return_share * expected_mps)
            return "" if known else self.doubt.reason
        if self._last is None:
            return ""
        gap_s, before_mps = now_s - self._last[0], self._last[1]
        if gap_s > LONGEST_S:
            before_mps = expected_mps
        most_mps = limits.tyre_accel_mps2 * gap_s + limits.step_mps + limits.step_share * abs(before_mps)
        if abs(speed_mps - before_mps) > most_mps:
            return f"jumps from {before_mps:z.2f} to {speed_mps:z.2f} m/s"
        return ""

    def _accel_reason(self, speed_mps: float, now_s: float) -> str:
        first, ends, limits = self._speeds.first, self._accels.ends, self._limits
        if first is None or ends is None or now_s - first[0] < limits.window_s / 2:
            return ""
        span_s = now_s - first[0]
        accel_mps2 = (speed_mps - first[1]) / span_s
        noise_mps2 = (limits.step_mps + limits.step_share * abs(speed_mps)) / span_s
        most_mps2 = max(ends[1], 0.0) + limits.drive_slack_mps2 + noise_mps2
        least_mps2 = min(ends[0], 0.0) - limits.brake_slack_mps2 - noise_mps2
        if least_mps2 <= accel_mps2 <= most_mps2:
            return ""
        return f"changes by {accel_mps2:.1f} m/s² while {ends[0]:.1f} to {ends[1]:.1f} m/s² are demanded"
