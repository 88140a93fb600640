"""Estimation of the steering delay from commands and measured wheel angles.

The vehicle file gives dead time T and lag τ. A model with these numbers is driven by the commands; its angle w
is compared with the measured one, m. A steering with a delay larger by θ has m(t) = w(t - θ) + b ≈ w - θ·w' +
b, a straight line of m - w over w', so that with sums over the drive and a prior of weight λ at θ = 0

    θ = -cov(m - w, w') / (var(w') + λ)

Old sums fade with new excitation and not with time: a straight road leaves the estimate unchanged. θ is used as
dead time even if part of it is lag: the response to a ramp is the same. It is limited to a share of T + τ; a
larger error is one of the vehicle file.

Ljung, System Identification (1999), sections 4.2 (linear regression) and 11.2 (forgetting).
"""

import math
from collections import deque

from controller.model.tyres import wheel_after
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.messages import VehicleState

_PRIOR = 3e-6  # λ [rad²/s]: a tenth of a second at the rate of the wheel in an S at 25 m/s
_WINDOW = 1e-3  # [rad²/s] of excitation after which older data has faded to 1/e
_GAP_S = 0.2  # after a longer gap between states the model restarts
_LONGEST_S = 1.0  # older commands are dropped: without a measured angle nothing takes them


class SteeringTiming:
    """Delay of one steering."""

    def __init__(self, vehicle: Vehicle, *, delay_s: float, share: float) -> None:
        """``delay_s``: from a command to the wheels; ``share`` of it plus the lag limits the estimate."""
        self._vehicle, self._delay_s = vehicle, delay_s
        self._most_s = share * (delay_s + vehicle.steering_lag_s)
        self._coming: deque[tuple[float, float]] = deque()  # time at which a command acts, angle
        self._t_s: float | None = None  # of the model
        self._model_rad = self._demand_rad = 0.0
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)  # 1, x, y, x², x·y over dt, x = w', y = m - w

    @property
    def late_s(self) -> float:
        """θ [s]; negative where the steering is faster than in the vehicle file."""
        one, x, y, xx, xy = self._sums
        if one == 0.0:
            return 0.0
        return within(-(xy - x * y / one) / (xx - x * x / one + _PRIOR), self._most_s)

    def add_command(self, angle_rad: float, *, now_s: float) -> None:
        """Add a command given at ``now_s``; without a limit for the estimate there is nothing to learn."""
        if self._most_s == 0.0:
            return
        self._coming.append((now_s + self._delay_s, angle_rad))
        while self._coming[0][0] < now_s - _LONGEST_S:
            self._coming.popleft()

    def add_state(self, state: VehicleState) -> None:
        """Update with a vehicle state; one under a driver is not used."""
        wheel_rad = state.road_wheel_angle_rad
        if self._most_s == 0.0 or wheel_rad is None:
            return
        before_s, self._t_s = self._t_s, state.t_s
        dt_s = state.t_s - before_s if before_s is not None else math.inf
        if state.driver_override or not 0.0 < dt_s < _GAP_S:
            self._model_rad = self._demand_rad = wheel_rad
            self._advance(state.t_s, state.t_s)
            return
        before_rad = self._model_rad
        self._advance(state.t_s - dt_s, state.t_s)
        self._learn((self._model_rad - before_rad) / dt_s, wheel_rad - self._model_rad, dt_s)

    def _advance(self, from_s: float, to_s: float) -> None:
        """The model from one time to another, by the commands that begin to act meanwhile."""
        while self._coming and self._coming[0][0] <= to_s:
            due_s, next_rad = self._coming.popleft()
            self._turn(due_s - from_s)
            from_s, self._demand_rad = at_least(due_s, from_s), next_rad
        self._turn(to_s - from_s)

    def _turn(self, dt_s: float) -> None:
        if dt_s > 0.0:
            self._model_rad = wheel_after(self._model_rad, self._demand_rad, dt_s, self._vehicle)

    def _learn(self, x: float, y: float, dt_s: float) -> None:
        keep = at_most(math.exp(-x * x * dt_s / _WINDOW), 1.0)
        new = (1.0, x, y, x * x, x * y)
        one, sx, sy, sxx, sxy = (keep * s + v * dt_s for s, v in zip(self._sums, new, strict=True))
        self._sums = (one, sx, sy, sxx, sxy)
