"""Understeer, steering ratio and offsets of a vehicle from a log of speed, wheel angle and yaw rate.

Steady state, as in :mod:`controller.model.bicycle`, with the unknowns of a log:

    θ/i + b = δ = atan(L·κ) + K·κ·v²        r_measured = v·κ + r₀

θ measured angle, i steering ratio (1 when θ is that of the road wheels), b steering offset (tyres minus sensor),
r₀ zero error of the yaw rate. Between steady states the single track with I_z = m·l_f·l_r, for which the axles are
two point masses, settles with the compliances D = m/C of the axles, D_f - D_r = K:

    w' = -v·r - w/(v·D_r)        w' + L·r' = -v·r + (δ - (w + L·r)/v)/D_f        w  lateral speed of the rear axle

so that only the smaller compliance D and the skew of the two sensors' clocks are fitted in addition. This is an
output error fit: the measured angle drives the model, and the yaw rate it gives is compared with the measured
one, both below 1 Hz. As the angle is noisy too, errors are weighted as

    e = (r - r_measured)/√(σ_r² + (∂r/∂θ)²·σ_θ²)

whose sum of squares is that of total least squares (Deming regression) for errors σ_θ, σ_r. σ_θ is the noise
of the angle, σ_r all other errors: gyroscope, wind, crossfall, model. Outliers have less weight (soft L1), and the
confidence intervals account for correlated errors (:mod:`cockpit.calibration.confidence`).

Fuller, Measurement Error Models (1987), section 1.3; Rajamani, Vehicle Dynamics and Control (2012), section 2.3;
Ljung, System Identification (1999), chapter 7.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from cockpit.calibration.confidence import NORMAL_95, covariance
from cockpit.calibration.drive_log import DriveLog
from controller.model.bicycle import GRAVITY_MPS2
from trepid.car.vehicle import GRADIENT, Vehicle
from trepid.types import Array, Mask

BAND_HZ = 1.0  # steering lies below it, the dynamics of the tyres above
PERIOD_S = 0.05  # of the fit
SLOWEST_MPS = 2.0  # below it understeer and the error of wheel encoders are too small and too large
LARGEST_MPS2 = 3.0  # tyres are linear below it; limit of ISO 11270
EDGE_S = 1.0  # transients of the filter and of the unknown first state
GAP_S = 0.25  # longer gaps are not interpolated
TURNING_MPS2 = 0.3  # from there on the vehicle turns
LEAST_S = 20.0  # of driving that can be used
LEAST_LATERAL_MPS2 = 0.5  # 95th percentile
WIDEST_GRADIENT = math.radians(0.5) / GRAVITY_MPS2  # ±0.5 deg/g: cars lie between 0.9 and 2.5 deg/g
WIDEST_RATIO = 0.10  # ± of the ratio
# Tyre compliance rises by 1 + x²·(1/6 + 1/(3·1.3²)) more at x = a_y/g: the magic formula with shape 1.3, first
# term of its series. The interval of K contains this as a standard deviation, since the model has linear tyres.
TYRE_RISE = 0.364
YAW_RATE_OFFSET_RADPS = 0.01  # prior: standard deviation of the zero error of consumer gyroscopes
COMPLIANCE = 0.006, 0.003  # prior of the smaller m/C [rad/(m/s²)]: axles have C/(m·g) of 10 to 30 per rad
SKEW_S = 0.1  # prior: standard deviation of the time between the two sensors
START_RADPS = 0.005  # scale of the first pass, which weights all errors alike

# θ in order: name, unit; None: fitted, but not reported.
FITTED = (
    (GRADIENT, "rad/(m/s²)"),
    ("steering_offset_rad", "rad"),
    ("yaw_rate_offset_radps", "rad/s"),
    (None, ""),  # the smaller compliance
    ("yaw_rate_delay_s", "s"),
    ("steering_ratio", "1"),
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """An estimate with its 95 % confidence interval."""

    value: float
    ci95: tuple[float, float]
    unit: str

    @property
    def half_width(self) -> float:
        """± of the interval."""
        return (self.ci95[1] - self.ci95[0]) / 2


@dataclass(frozen=True, slots=True)
class Identification:
    """Parameters by name, measures of excitation, and the reason where parameters are refused."""

    parameters: dict[str, Parameter]
    excitation: dict[str, float]
    refused: str | None


def interval(value: float, variance: float, unit: str) -> Parameter:
    """``value`` ± 1.96 standard deviations."""
    half = NORMAL_95 * math.sqrt(variance)
    return Parameter(value, (value - half, value + half), unit)


@dataclass(frozen=True, slots=True)
class EvenLog:
    """A log on an even grid, low-pass filtered at ``BAND_HZ``."""

    t_s: Array
    speed_mps: Array
    angle_rad: Array
    yaw_rate_radps: Array
    used: Mask
    angle_noise_rad: float  # within the band

    @property
    def lateral_mps2(self) -> Array:
        """v·r, less the zero error of the yaw rate as far as its median shows it."""
        return self.speed_mps * self.yaw_rate_radps


def identify_understeer(
    log: DriveLog, vehicle: Vehicle, *, known_ratio: bool = False, anyway: bool = False
) -> Identification:
    """K_us, offsets and, for an angle of the steering wheel, the ratio; the wheelbase is that of ``vehicle``.

    With ``known_ratio`` the ratio is that of ``vehicle``. Parameters that the log does not excite are refused
    with a reason; ``anyway`` returns the estimates as well, where there is enough to fit.
    """
    drive = resample_evenly(log)
    excitation = excitation_measures(drive)
    refused = lacking(excitation)
    if refused and not (anyway and excitation["used_s"] >= LEAST_S):
        return Identification({}, excitation, refused)
    fit = Fit(drive, vehicle, at_steering_wheel=log.at_steering_wheel, known_ratio=known_ratio)
    try:
        theta, spread = fit.solve()
    except np.linalg.LinAlgError:
        return Identification(
            {}, excitation, "the log does not separate the parameters: vary speed and bends"
        )
    deviation = np.sqrt(np.diag(spread))
    rise = TYRE_RISE * (excitation["lateral_accel_p95_mps2"] / GRAVITY_MPS2) ** 2
    deviation[0] = math.hypot(deviation[0], rise * theta[0])
    if fit.free_ratio:
        correlation = spread[0, 5] / math.sqrt(spread[0, 0] * spread[5, 5])
        excitation["correlation_of_ratio_and_understeer"] = float(correlation)
    parameters = {
        name: interval(float(value), float(width**2), unit)
        for (name, unit), value, width in zip(FITTED, theta, deviation, strict=False)
        if name is not None
    }
    refused = refused or unsure(parameters, excitation)
    return Identification({} if refused and not anyway else parameters, excitation, refused)


def resample_evenly(log: DriveLog) -> EvenLog:
    """The log on an even grid of ``PERIOD_S`` or its own period, low-passed without delay."""
    step_s = float(np.median(np.diff(log.t_s)))
    fine_s = np.arange(log.t_s[0], log.t_s[-1], step_s)
    columns = [np.interp(fine_s, log.t_s, c) for c in (log.speed_mps, log.angle_rad, log.yaw_rate_radps)]
    noise_rad = jitter(log.angle_rad)
    if step_s < 0.4 / BAND_HZ and len(fine_s) > 30:
        low_pass = butter(4, BAND_HZ, fs=1.0 / step_s, output="sos")
        columns = [sosfiltfilt(low_pass, column) for column in columns]
        noise_rad *= math.sqrt(2.0 * BAND_HZ * step_s)
    every = max(1, round(PERIOD_S / step_s))
    t_s = fine_s[::every]
    speed_mps, angle_rad, yaw_rate_radps = (column[::every] for column in columns)
    used = (speed_mps >= SLOWEST_MPS) & ~near_gap(t_s, log.t_s)
    used &= np.abs(speed_mps * yaw_rate_radps) <= LARGEST_MPS2
    return EvenLog(t_s, speed_mps, angle_rad, yaw_rate_radps, used, noise_rad)


def near_gap(t_s: Array, stamps_s: Array) -> Mask:
    """Which of ``t_s`` lie within ``EDGE_S`` of a silence of the log, its begin or its end."""
    silent = np.flatnonzero(np.diff(stamps_s) > GAP_S)
    near = (t_s < stamps_s[0] + EDGE_S) | (t_s > stamps_s[-1] - EDGE_S)
    for i in silent:
        near |= (t_s > stamps_s[i] - EDGE_S) & (t_s < stamps_s[i + 1] + EDGE_S)
    return near


def jitter(values: Array) -> float:
    """Standard deviation of the noise of a smooth signal from its second differences, or of its rounding."""
    if len(values) < 4:
        return 0.0
    steps = np.abs(np.diff(values))
    noise = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)
    moving = steps[steps > 1e-12]
    # Half of the samples stand still: the signal is coarser than its noise.
    rounding = float(moving.min()) / math.sqrt(12.0) if len(moving) < len(steps) / 2 and len(moving) else 0.0
    return max(noise, rounding)


def excitation_measures(drive: EvenLog) -> dict[str, float]:
    """Usable seconds, speeds and lateral accelerations of the log."""
    used = drive.used
    period_s = float(drive.t_s[1] - drive.t_s[0]) if len(drive.t_s) > 1 else 0.0
    offered = {"used_s": float(used.sum() * period_s)}
    if not used.any():
        return offered
    speed_mps, lateral_mps2 = drive.speed_mps[used], drive.lateral_mps2[used]
    slow, fast = np.percentile(speed_mps, (5, 95))
    return offered | {
        "speed_p5_mps": float(slow),
        "speed_p95_mps": float(fast),
        "lateral_accel_p95_mps2": float(np.percentile(np.abs(lateral_mps2), 95)),
        "turning_left_s": float((lateral_mps2 > TURNING_MPS2).sum() * period_s),
        "turning_right_s": float((lateral_mps2 < -TURNING_MPS2).sum() * period_s),
    }


def lacking(excitation: dict[str, float]) -> str | None:
    """The first requirement of the fit that the log does not meet, as text; None if it meets all."""
    if excitation["used_s"] < LEAST_S:
        return (
            f"only {excitation['used_s']:.0f} s of driving faster than {SLOWEST_MPS:g} m/s "
            f"and within {LARGEST_MPS2:g} m/s² to the side; {LEAST_S:g} s are needed"
        )
    lateral_mps2 = excitation["lateral_accel_p95_mps2"]
    if lateral_mps2 < LEAST_LATERAL_MPS2:
        return (
            f"too little lateral acceleration: 95 % of the log stays below {lateral_mps2:.2f} m/s²; "
            f"drive bends at {LEAST_LATERAL_MPS2:g} m/s² and more, better 2"
        )
    return None


def unsure(parameters: dict[str, Parameter], excitation: dict[str, float]) -> str | None:
    """The reason why the intervals are too wide; None: they are not."""
    gradient, ratio = parameters[GRADIENT], parameters.get("steering_ratio")
    slow, fast = excitation["speed_p5_mps"], excitation["speed_p95_mps"]
    wide = gradient.half_width > WIDEST_GRADIENT
    plus_minus = f"±{math.degrees(gradient.half_width * GRAVITY_MPS2):.2f} deg/g"
    if ratio is not None and (wide or ratio.half_width > WIDEST_RATIO * ratio.value):
        return (
            f"too little spread of speed in bends to tell understeer ({plus_minus}) from the steering ratio "
            f"(±{100 * ratio.half_width / ratio.value:.0f} %): {slow:.0f} to {fast:.0f} m/s; turn at walking "
            "pace as well, or hold the ratio by --known-ratio"
        )
    if wide:
        return (
            f"the understeer stays unknown to {plus_minus}: drive longer, or faster in bends on both sides "
            f"(now {excitation['lateral_accel_p95_mps2']:.1f} m/s² at {slow:.0f} to {fast:.0f} m/s)"
        )
    return None


class Fit:
    """The problem of least squares over θ = (K, b, r₀, D, skew[, i])."""

    def __init__(
        self, drive: EvenLog, vehicle: Vehicle, *, at_steering_wheel: bool, known_ratio: bool
    ) -> None:
        self.drive = drive
        self.wheelbase_m = vehicle.wheelbase_m
        self.free_ratio = at_steering_wheel and not known_ratio
        self.ratio = vehicle.steering_ratio if at_steering_wheel else 1.0
        self.angle_noise_rad, self.rest_radps = 0.0, START_RADPS
        fastest_mps = float(drive.speed_mps.max())
        oversteer = -0.9 * self.wheelbase_m / fastest_mps**2  # stable at every speed of the log
        names = len(FITTED) if self.free_ratio else len(FITTED) - 1
        self.start = np.array([0.002, 0.0, 0.0, COMPLIANCE[0], 0.0, self.ratio])[:names]
        self.low = np.array([oversteer, -0.2, -0.1, 1e-4, -0.5, 1.0])[:names]
        self.high = np.array([0.03, 0.2, 0.1, 0.03, 0.5, 100.0])[:names]
        self.scale = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-2, 1.0])[:names]

    def solve(self) -> tuple[Array, Array]:
        """θ and its covariance. Raises LinAlgError when a parameter has no effect."""
        theta = self._minimise(self.start, loss="linear")
        for _ in range(2):
            self._weigh(theta)
            theta = self._minimise(theta, loss="soft_l1")
        jacobian = self._jacobian(theta)
        samples = len(self.drive.t_s)
        rows = self.rows(theta)
        return theta, covariance(jacobian[:samples], rows[:samples], jacobian[samples:])

    def rows(self, theta: Array) -> Array:
        """Weighted errors, zero for unused samples, followed by the deviations of θ from its prior."""
        error = (self.yaw_rate_radps(theta) - self.drive.yaw_rate_radps) / self._sigma_radps(theta)
        zero, compliance, skew = theta[2:5]
        prior = (zero / YAW_RATE_OFFSET_RADPS, (compliance - COMPLIANCE[0]) / COMPLIANCE[1], skew / SKEW_S)
        return np.append(np.where(self.drive.used, error, 0.0), prior)

    def yaw_rate_radps(self, theta: Array) -> Array:
        """Yaw rate [rad/s] that the sensor reads by the model."""
        gradient, offset_rad, zero_radps, compliance, skew_s = theta[:5]
        drive, wheelbase_m = self.drive, self.wheelbase_m
        measured = np.interp(drive.t_s - skew_s, drive.t_s, drive.angle_rad)
        angle_rad = measured / self._ratio(theta) + offset_rad
        speed_mps = np.maximum(drive.speed_mps, 1.0)
        # The angle that a linear vehicle would need for the curvature that this one settles at.
        curvature_1pm = steady_curvature(angle_rad, speed_mps, gradient, wheelbase_m)
        linear_rad = (wheelbase_m + gradient * speed_mps**2) * curvature_1pm
        front, rear = compliance + max(gradient, 0.0), compliance + max(-gradient, 0.0)
        period_s = drive.t_s[1] - drive.t_s[0]
        return settling(linear_rad, speed_mps, wheelbase_m, front, rear, period_s) + zero_radps

    def _ratio(self, theta: Array) -> float:
        return float(theta[5]) if self.free_ratio else self.ratio

    def _gain(self, theta: Array) -> Array:
        """∂r/∂θ in steady state."""
        speed_mps = self.drive.speed_mps
        return np.asarray(speed_mps / (self.wheelbase_m + theta[0] * speed_mps**2) / self._ratio(theta))

    def _sigma_radps(self, theta: Array) -> Array:
        return np.hypot(self.rest_radps, self._gain(theta) * self.angle_noise_rad)

    def _weigh(self, theta: Array) -> None:
        """Split the residual into the noise of the angle and the rest."""
        used = self.drive.used
        left = (self.yaw_rate_radps(theta) - self.drive.yaw_rate_radps)[used]
        total_radps = 1.4826 * float(np.median(np.abs(left - np.median(left))))
        self.angle_noise_rad = self.drive.angle_noise_rad
        of_angle = float(np.mean((self._gain(theta)[used] * self.angle_noise_rad) ** 2))
        self.rest_radps = math.sqrt(max(total_radps**2 - of_angle, (0.1 * total_radps) ** 2, 1e-12))

    def _minimise(self, theta: Array, *, loss: str) -> Array:
        start = np.clip(theta, self.low, self.high)
        limits = dict(bounds=(self.low, self.high), x_scale=self.scale, xtol=1e-6, ftol=1e-8)
        return np.asarray(least_squares(self.rows, start, loss=loss, **limits).x)

    def _jacobian(self, theta: Array) -> Array:
        """Central differences, forward or backward at a bound."""
        columns = []
        for i, scale in enumerate(self.scale):
            ends = np.clip(theta[i] + np.array([-1e-3, 1e-3]) * scale, self.low[i], self.high[i])
            below, above = (self.rows(np.where(np.arange(len(theta)) == i, end, theta)) for end in ends)
            columns.append((above - below) / (ends[1] - ends[0]))
        return np.column_stack(columns)


def steady_curvature(angle_rad: Array, speed_mps: Array, gradient: float, wheelbase_m: float) -> Array:
    """κ of δ = atan(L·κ) + K·κ·v², for each sample: Newton on θ + c·tan θ = δ with θ = atan(L·κ), c = K·v²/L."""
    compliance = gradient * speed_mps**2 / wheelbase_m
    rolling = np.clip(angle_rad / (1.0 + compliance), -1.2, 1.2)
    for _ in range(4):  # the error of the third step is below 1e-9 rad for any car
        tangent = np.tan(rolling)
        slope = 1.0 + compliance * (1.0 + tangent**2)
        step = (rolling + compliance * tangent - angle_rad) / np.maximum(slope, 0.05)
        rolling = np.clip(rolling - step, -1.2, 1.2)
    return np.asarray(np.tan(rolling) / wheelbase_m)


def settling(
    angle_rad: Array, speed_mps: Array, wheelbase_m: float, front: float, rear: float, period_s: float
) -> Array:
    """Yaw rate r of the linear single track of the module's docstring, settled at the first sample.

    The trapezoidal rule over all samples is one banded system in (w₀, r₀, w₁, r₁, …).
    """
    v, half_s = speed_mps, period_s / 2
    # (w, r)' = A·(w, r) + (0, push)
    a_ww, a_wr = -1.0 / (v * rear), -v
    a_rw, a_rr = (1.0 / (v * rear) - 1.0 / (v * front)) / wheelbase_m, -1.0 / (v * front)
    push = angle_rad / (front * wheelbase_m)
    rate = angle_rad[0] * v[0] / (wheelbase_m + (front - rear) * v[0] ** 2)
    first = np.array([-rear * v[0] ** 2 * rate, rate])
    band = np.zeros((5, 2 * len(v)))  # entry (i, j) of the matrix stands at band[1 + i - j, j]
    band[1, 0::2], band[0, 1::2] = 1.0 - half_s * a_ww, -half_s * a_wr
    band[2, 0::2], band[1, 1::2] = -half_s * a_rw, 1.0 - half_s * a_rr
    band[3, 0:-2:2], band[2, 1:-2:2] = -1.0 - half_s * a_ww[:-1], -half_s * a_wr[:-1]
    band[4, 0:-2:2], band[3, 1:-2:2] = -half_s * a_rw[:-1], -1.0 - half_s * a_rr[:-1]
    band[:3, :2] = 0.0
    band[1, :2] = 1.0  # the first two rows: the given start
    right = np.zeros(2 * len(v))
    right[:2] = first
    right[3::2] = half_s * (push[1:] + push[:-1])
    return np.asarray(solve_banded((3, 1), band, right)[1::2])
