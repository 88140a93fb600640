"""Dead time and time constant of the steering from a log of commanded and measured wheel angle.

    δ' = clip((u(t - T) - δ)/τ, ±rate)        δ_measured = δ + c

u command, held until the next one; T dead time; τ time constant; c constant bias between command and sensor. The
rate limit is that of the vehicle file. An output error fit: the command drives the model and the angle it gives is
compared with the measured one, at every sample. A grid over T and τ finds the valley, least squares its bottom.

T runs from the time stamp of the command in the log to the time stamp of the angle, with all that lies between:
transport of the command, and the age of the measurement.

Ljung, System Identification (1999), sections 7.3 (output error) and 10.2 (search).
"""

import math

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from cockpit.calibration.confidence import covariance
from cockpit.calibration.drive_log import DriveLog
from cockpit.calibration.identification import GAP_S, Identification, interval, jitter
from trepid.car.vehicle import Vehicle
from trepid.types import Array, Mask

DEAD_TIMES_S = np.arange(0.0, 0.65, 0.05)
TIME_CONSTANTS_S = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
LONGEST_S = 2.0
SETTLED_S = 2.0  # after a silence or a driver's hand the model and the wheels agree again
LEAST_S = 5.0
LEAST_NOISES = 5.0  # the command must move the wheels by more than the sensor jitters, ...
LEAST_RAD = 0.0005  # ... and by more than any sensor resolves (road wheel)
WIDEST_S = 0.05  # ± of dead time plus time constant
MOVE_S = 0.5  # over which moves of the command are counted


def identify_response(log: DriveLog, vehicle: Vehicle) -> Identification:
    """Dead time and time constant. Refuses, with a reason, where the log has no commands that move the wheels."""
    if len(log.command_t_s) < 2:
        return Identification({}, {}, "the log has no commands")
    fit = ResponseFit(log, vehicle)
    used_s = float(fit.used.sum() * fit.period_s)
    if used_s < LEAST_S:
        return Identification({}, {}, f"only {used_s:.0f} s under command; {LEAST_S:g} s are needed")
    excitation = {"commanded_s": used_s, "command_move_p95_rad": fit.moves_rad() / fit.ratio}
    least_rad = max(LEAST_NOISES * fit.noise_rad / fit.ratio, LEAST_RAD)
    if excitation["command_move_p95_rad"] < least_rad:
        reason = (
            f"the command hardly moves: 95 % of its moves within {MOVE_S:g} s are below "
            f"{excitation['command_move_p95_rad']:.4f} rad of the road wheel; {least_rad:.4f} rad are needed"
        )
        return Identification({}, excitation, reason)
    (delay_s, lag_s), spread = fit.solve()
    both_s = interval(float(delay_s + lag_s), float(spread.sum()), "s")
    if both_s.half_width > WIDEST_S:
        half_s = f"{both_s.half_width:.2f}"
        reason = f"dead time plus time constant stay unknown to ±{half_s} s: steer faster or longer"
        return Identification({}, excitation, reason)
    parameters = {
        "steering_delay_s": interval(float(delay_s), float(spread[0, 0]), "s"),
        "steering_lag_s": interval(float(lag_s), float(spread[1, 1]), "s"),
        "steering_delay_plus_lag_s": both_s,
    }
    return Identification(parameters, excitation, None)


class ResponseFit:
    """The problem of least squares over (T, τ)."""

    def __init__(self, log: DriveLog, vehicle: Vehicle) -> None:
        self.ratio = vehicle.steering_ratio if log.at_steering_wheel else 1.0
        self.rate_radps = vehicle.max_road_wheel_rate_radps * self.ratio
        self.period_s = float(np.median(np.diff(log.t_s)))
        begin_s = max(log.t_s[0], log.command_t_s[0])
        end_s = max(min(log.t_s[-1], log.command_t_s[-1]), begin_s + 2 * self.period_s)
        self.t_s = np.arange(begin_s, end_s, self.period_s)
        self.angle_rad = np.interp(self.t_s, log.t_s, log.angle_rad)
        self.noise_rad = jitter(log.angle_rad)
        # ∫u dt, so that the mean of a held command over any span is exact.
        self._knots_s, at = np.unique(log.command_t_s, return_index=True)
        self._command_rad = log.command_rad[at]
        held = np.diff(self._knots_s) * self._command_rad[:-1]
        self._integral = np.concatenate([[0.0], np.cumsum(held)])
        self.used = self._usable(log)

    def _usable(self, log: DriveLog) -> Mask:
        t_s = self.t_s
        used = t_s > t_s[0] + SETTLED_S
        for stamps_s in (log.t_s, self._knots_s):
            for i in np.flatnonzero(np.diff(stamps_s) > GAP_S):
                used &= (t_s < stamps_s[i]) | (t_s > stamps_s[i + 1] + SETTLED_S)
        for when_s in log.t_s[log.driver_override > 0.5][:: max(1, round(0.1 / self.period_s))]:
            used &= (t_s < when_s - 0.2) | (t_s > when_s + SETTLED_S)
        return np.asarray(used)

    def moves_rad(self) -> float:
        """95th percentile of the change of the command within ``MOVE_S``."""
        apart = max(1, round(MOVE_S / self.period_s))
        held = self._demand(0.0)
        moves = np.abs(held[apart:] - held[:-apart])[self.used[apart : len(held)]]
        return float(np.percentile(moves, 95)) if len(moves) else 0.0

    def solve(self) -> tuple[Array, Array]:
        """(T, τ) and their covariance."""
        pairs = [(delay_s, lag_s) for delay_s in DEAD_TIMES_S for lag_s in TIME_CONSTANTS_S]
        start = min(pairs, key=lambda pair: float((self.left_rad(np.array(pair)) ** 2).sum()))
        low, high = np.array([-0.05, 1e-3]), np.array([LONGEST_S, LONGEST_S])
        scale_rad = 1.0
        theta = np.array(start)
        for loss in ("linear", "soft_l1"):
            theta = least_squares(
                lambda pair, scale_rad=scale_rad: self.left_rad(pair) / scale_rad,
                np.clip(theta, low, high),
                bounds=(low, high),
                x_scale=0.05,
                diff_step=1e-3,
                loss=loss,
            ).x
            left = self.left_rad(theta)[self.used]
            scale_rad = max(1.4826 * float(np.median(np.abs(left))), 1e-9)
        step_s = 1e-4
        columns = [
            (self.left_rad(theta + shift) - self.left_rad(theta - shift)) / (2 * step_s * scale_rad)
            for shift in step_s * np.eye(2)
        ]
        spread = covariance(np.column_stack(columns), self.left_rad(theta) / scale_rad, np.zeros((0, 2)))
        return np.asarray(theta), spread

    def left_rad(self, theta: Array) -> Array:
        """Model minus measurement, without the bias; zero where the log is not used."""
        delay_s, lag_s = float(theta[0]), float(theta[1])
        model_rad = follow_demand(
            self._demand(delay_s), self.angle_rad[0], lag_s, self.rate_radps, self.period_s
        )
        left = model_rad - self.angle_rad
        return np.where(self.used, left - left[self.used].mean(), 0.0)

    def _demand(self, delay_s: float) -> Array:
        """Mean demand of the steering between each sample and the next, one less than samples."""
        at_s = self.t_s - delay_s
        integral = np.interp(at_s, self._knots_s, self._integral)
        integral += np.minimum(at_s - self._knots_s[0], 0.0) * self._command_rad[0]
        integral += np.maximum(at_s - self._knots_s[-1], 0.0) * self._command_rad[-1]
        return np.asarray(np.diff(integral) / self.period_s)


def follow_demand(
    demand_rad: Array, start_rad: float, lag_s: float, rate_radps: float, period_s: float
) -> Array:
    """Angle at every sample of a first-order lag behind ``demand_rad``, no faster than ``rate_radps``."""
    keep = math.exp(-period_s / lag_s)
    first = demand_rad[0] if not math.isfinite(start_rad) else start_rad
    free, _ = lfilter([1.0 - keep], [1.0, -keep], demand_rad, zi=[keep * first])
    free = np.concatenate([[first], free])
    most_rad = rate_radps * period_s
    if np.abs(np.diff(free)).max() <= most_rad:
        return np.asarray(free)
    angle, angles = first, [first]
    for demand in demand_rad.tolist():
        angle += max(-most_rad, min(most_rad, (1.0 - keep) * (demand - angle)))
        angles.append(angle)
    return np.array(angles)
