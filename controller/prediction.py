"""The state to steer with: car and lane at the moment at which a steering command given now begins to act.

The path is as old as its frame, and a command acts only after the dead time of the steering. Both times are known,
and the lane is moved over them: from the capture of the frame to the last vehicle state by measured speed and yaw
rate, from there to now + dead time by the commands already given, through the models of steering
and tyres (`controller.model.tyres`). The drift is computed from the measured yaw rate.

The feedback then controls a plant without dead time (Smith predictor; Åström & Hägglund, Advanced PID Control
(2006), section 8.4).

While the measured speed is doubted, :class:`ReckonedSpeed` takes its place.
"""

import math
from collections import deque

from controller.laws.law import Acting
from controller.model.tyres import Turning, Tyres, wheel_after
from controller.steering_timing import SteeringTiming
from trepid.bounds import at_least, at_most
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, LaneFields, lane_after
from trepid.messages import VehicleState

_STEP_S = 0.02  # of the model; the wheel is exact for any step, the pose of second order


class Predictor:
    """Keeps the measured motion and the commands of the last ``memory_s``."""

    def __init__(
        self, vehicle: Vehicle, *, command_delay_s: float, memory_s: float, timing_share: float = 0.0
    ) -> None:
        """``command_delay_s``: from the controller to the actuator, mean hold of the command included.

        ``timing_share``: largest estimated change of the delay, as a share of dead time plus lag.
        """
        self._vehicle, self._tyres = vehicle, Tyres(vehicle)
        self._delay_s = command_delay_s + vehicle.steering_delay_s
        self._longest_s = self._delay_s + timing_share * (self._delay_s + vehicle.steering_lag_s)
        self._timing = SteeringTiming(vehicle, delay_s=self._delay_s, share=timing_share)
        self._memory_s = memory_s
        self._motion: deque[tuple[float, float, float, float]] = deque()  # time, speed, yaw rate, drift
        self._commands: deque[tuple[float, float]] = deque()  # time at which it was given, angle
        self._wheel_rad = 0.0

    def adopt(self, vehicle: Vehicle) -> None:
        """Use the present parameters of the vehicle, whose understeer may be estimated while driving."""
        if vehicle is not self._vehicle:
            self._vehicle, self._tyres = vehicle, Tyres(vehicle)

    def add_state(self, state: VehicleState, speed_mps: float) -> None:
        """Add a vehicle state; a repeated or older one changes nothing."""
        if self._motion and state.t_s <= self._motion[-1][0]:
            return
        self._timing.add_state(state)
        if state.road_wheel_angle_rad is not None:
            self._wheel_rad = state.road_wheel_angle_rad
        elif self._commands:
            self._wheel_rad = self._commands[-1][1]
        rate = state.yaw_rate_radps
        if rate is None:
            rate = speed_mps * self._tyres.steady_1pm(self._wheel_rad, speed_mps)
        self._motion.append((state.t_s, speed_mps, rate, self._drift(state.t_s, speed_mps, rate)))
        while len(self._motion) > 2 and self._motion[1][0] < state.t_s - self._memory_s:
            self._motion.popleft()

    def _drift(self, t_s: float, speed_mps: float, rate: float) -> float:
        """Drift [rad] of the rear axle at ``t_s``; the settled value after the first state."""
        if not self._motion:
            return self._tyres.drift_after(0.0, rate, speed_mps, math.inf)
        before_s, _, before_rate, drift_rad = self._motion[-1]
        return self._tyres.drift_after(drift_rad, 0.5 * (before_rate + rate), speed_mps, t_s - before_s)

    def add_command(self, angle_rad: float, *, now_s: float) -> None:
        """Add a command given at ``now_s``."""
        self._timing.add_command(angle_rad, now_s=now_s)
        self._commands.append((now_s, angle_rad))
        while len(self._commands) > 1 and self._commands[1][0] < now_s - self._longest_s:
            self._commands.popleft()

    @property
    def _dead_s(self) -> float:
        """From a command to its first effect."""
        return at_least(self._delay_s + self._timing.late_s, 0.0)

    def at_last_state(self, lane: Lane, *, valid_s: float) -> tuple[Lane, float]:
        """``lane``, valid at ``valid_s``, at the last vehicle state if that is later, and its time."""
        motion = self._motion
        new = len(motion)
        while new > 1 and motion[new - 1][0] > valid_s:
            new -= 1
        moved: LaneFields = lane
        for i in range(new, len(motion)):
            (t0, v0, r0, drift0), (t1, v1, r1, drift1) = motion[i - 1], motion[i]
            if t1 > valid_s:
                dt_s = t1 - at_least(valid_s, t0)
                drift_rad = 0.5 * (drift0 + drift1)
                moved = lane_after(moved, dt_s, 0.5 * (v0 + v1), 0.5 * (r0 + r1), drift_rad)
        return Lane(*moved), at_least(motion[-1][0], valid_s) if motion else valid_s

    def when_steering_acts(self, lane: Lane, *, valid_s: float, now_s: float) -> Acting:
        """``lane``, valid at ``valid_s``, as the last vehicle state or later, at ``now_s`` plus the dead time."""
        if not self._motion:
            return Acting(lane, 0.0, 0.0, 0.0, 0.0, lane)
        speed_mps = self._motion[-1][1]
        dead_s = self._dead_s
        then, wheel_rad, turning = self._along_commands(lane, valid_s - dead_s, now_s)
        return Acting(
            lane=then._replace(heading_rad=then.heading_rad + turning.drift_rad),
            speed_mps=speed_mps,
            wheel_rad=wheel_rad,
            curvature_1pm=self._tyres.path_1pm(turning, speed_mps),
            steady_1pm=self._tyres.steady_1pm(wheel_rad, speed_mps),
            seen=lane,
        )

    def _along_commands(self, lane: Lane, from_s: float, to_s: float) -> tuple[Lane, float, Turning]:
        """Lane, wheel angle and turn after the commands given between the two times, each one dead time later.

        Before the first kept command the demand is the measured wheel angle.
        """
        _, speed_mps, rate, drift_rad = self._motion[-1]
        moved: LaneFields = lane
        wheel_rad = demand_rad = self._wheel_rad
        turning = self._tyres.turning(rate, drift_rad, wheel_rad, speed_mps)
        for due_s, next_rad in (*self._commands, (math.inf, 0.0)):
            constant_s = at_most(to_s, due_s)
            while from_s < constant_s:
                until_s = at_most(from_s + _STEP_S, constant_s)
                before_rad, before, dt_s = wheel_rad, turning, until_s - from_s
                wheel_rad = wheel_after(wheel_rad, demand_rad, dt_s, self._vehicle)
                turning = self._tyres.after(turning, before_rad, wheel_rad, speed_mps, dt_s)
                rate = 0.5 * speed_mps * (before.yaw_1pm + turning.yaw_1pm)
                drift_rad = 0.5 * (before.drift_rad + turning.drift_rad)
                moved = lane_after(moved, dt_s, speed_mps, rate, drift_rad)
                from_s = until_s
            demand_rad = next_rad
        return Lane(*moved), wheel_rad, turning


class ReckonedSpeed:
    """v' = min(a, 0) from the last measurement on, a the demand behind the lag of the drive; never below 0."""

    def __init__(self, drive_lag_s: float) -> None:
        self._lag_s = drive_lag_s
        self._accel_mps2 = 0.0
        self._speed_mps: float | None = None  # None before the first measurement
        self.demand_mps2 = 0.0
        """The last demand of acceleration, to be set after every step."""

    def step(self, measured_mps: float | None, dt_s: float) -> float | None:
        """The measured speed, or what is left of the last one ``dt_s`` after the last step; None without any."""
        if dt_s > 0.0:
            self._accel_mps2 += dt_s / (self._lag_s + dt_s) * (self.demand_mps2 - self._accel_mps2)
        if measured_mps is not None:
            self._speed_mps = measured_mps
        elif self._speed_mps is not None:
            self._speed_mps = at_least(self._speed_mps + at_most(self._accel_mps2, 0.0) * dt_s, 0.0)
        return self._speed_mps
