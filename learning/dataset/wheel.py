"""Road-wheel angles from recorded steering.

    δ = sign·s·δ_lock            steering s as a share of full lock, -1 to 1
    δ = sign·θ/i                 angle θ of the steering wheel, i steering ratio (1: of the road wheels)
    label = atan(L·κ(δ, v))      κ by the bicycle with understeer (:mod:`controller.model.bicycle`)

so that the label is what a car without understeer would need for the same path. Where the speed is not known the
label is δ.

An unknown lock angle is fitted to a recorded yaw rate r and speed v: atan(L·r/v) + K·v·r = sign·s·δ_lock + c, by
robust regression; c takes the offsets of both sensors.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from controller.model.bicycle import curvature_from_angle
from learning.dataset.dataset import Wheel
from learning.dataset.sources.log import Log, SteeringUnit
from trepid.car.vehicle import GRADIENT, Side, Vehicle, road_wheel_angle
from trepid.config import CONFIG_DIR, InputError, car_folder, load
from trepid.types import Column

SLOWEST_MPS = 0.3  # of the fit of the lock angle
LEAST_TURNING = 100  # samples with steering, of the fit
TURNING = 0.05  # share of full lock
SCATTER_RAD = 0.02  # of the robust fit
LEAST_CORRELATION = 0.5


@dataclass(frozen=True, slots=True)
class WheelOptions:
    """What is known about the steering of the recorded car, besides ``--car``."""

    lock_deg: float | None = None
    left_positive: bool | None = None  # None: as the format has it
    wheelbase_m: float | None = None
    ratio: float | None = None


def wheel_of(logs: list[Log], options: WheelOptions) -> Wheel:
    """How the steering of ``logs``, of one car, becomes road-wheel angles. Raises InputError."""
    units, signs = {log.unit for log in logs}, {log.left_positive for log in logs}
    log, car = logs[0], car_folder()
    vehicle = known_vehicle(logs)
    left = options.left_positive
    if left is None and vehicle is not None and vehicle.logged_positive is not None:
        left = (
            vehicle.logged_positive == Side.LEFT if log.unit != SteeringUnit.KINEMATIC else log.left_positive
        )
    if len(units) > 1 or (len(signs) > 1 and left is None):
        raise InputError("the sources hold steering in different units or signs: build a data set of each")
    if left is None:
        left = log.left_positive
    wheel = Wheel(
        lock_rad=None, how="angles in the log", sign=1 if left else -1, wheelbase_m=options.wheelbase_m
    )
    if log.unit == SteeringUnit.KINEMATIC:
        return wheel
    if vehicle is not None:
        moving = any(np.isfinite(log.speed_mps).any() for log in logs)  # understeer needs the speed
        of_the_car = {
            "k_us": vehicle.understeer_gradient_rad_per_mps2 if moving else 0.0,
            "wheelbase_m": options.wheelbase_m or vehicle.wheelbase_m,
        }
        wheel = wheel.model_copy(update=of_the_car)
    if log.unit == SteeringUnit.WHEEL:
        ratio = options.ratio or (vehicle.steering_ratio if vehicle is not None else None)
        if ratio is None:
            raise InputError(
                f"{log.path}: holds angles of the steering wheel: give --steering-ratio or --car"
            )
        source = "given" if options.ratio else f"of {car}"
        how = f"angles in the log, steering ratio {source}"
        return wheel.model_copy(update={"how": how, "ratio": ratio})
    if log.unit == SteeringUnit.ROAD:
        return wheel
    lock_rad, how = _lock(logs, options, vehicle if car else None, wheel)
    return wheel.model_copy(update={"lock_rad": lock_rad, "how": how})


def known_vehicle(logs: list[Log]) -> Vehicle | None:
    """The car of ``--car``; of recordings of Trepid that of ``config/``; None for other logs without ``--car``."""
    if car_folder() is None and any(log.kind != "recording" for log in logs):
        return None
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def _lock(logs: list[Log], options: WheelOptions, vehicle: Vehicle | None, wheel: Wheel) -> tuple[float, str]:
    if options.lock_deg is not None:
        return math.radians(options.lock_deg), "given"
    if vehicle is not None:
        return vehicle.max_road_wheel_angle_rad, f"car file {car_folder()}"
    fitted = fitted_lock(logs, wheel)
    if fitted is not None:
        return fitted
    log = logs[0]
    if log.lock_rad is None:
        raise InputError(f"{log.path}: the lock angle is not known: give --lock-deg or --car")
    return log.lock_rad, f"assumed {math.degrees(log.lock_rad):g}°: {log.lock_source}"


def fitted_lock(logs: list[Log], wheel: Wheel) -> tuple[float, str] | None:
    """Lock angle [rad] and a description of the fit; None where wheelbase, yaw rate, speed or bends are missing."""
    if wheel.wheelbase_m is None:
        return None
    steering, speed_mps, yaw_rate_radps = (
        np.concatenate([getattr(log, name) for log in logs])
        for name in ("steering", "speed_mps", "yaw_rate_radps")
    )
    used = np.isfinite(steering) & np.isfinite(yaw_rate_radps) & (speed_mps > SLOWEST_MPS)
    if (used & (np.abs(steering) > TURNING)).sum() < LEAST_TURNING:
        return None
    share = wheel.sign * steering[used]
    rate_radps, v_mps = yaw_rate_radps[used], speed_mps[used]
    angle_rad = np.arctan(wheel.wheelbase_m * rate_radps / v_mps) + wheel.k_us * v_mps * rate_radps
    correlation = float(np.corrcoef(share, angle_rad)[0, 1])
    if not correlation > LEAST_CORRELATION:
        return None
    found = least_squares(
        lambda theta: (theta[0] * share + theta[1] - angle_rad) / SCATTER_RAD,
        x0=(math.radians(25.0), 0.0),
        loss="soft_l1",
    )
    if not 0.0 < found.x[0] < math.pi / 3:
        return None
    how = f"fitted: to yaw rate and speed of {used.sum()} rows, correlation {correlation:.2f}"
    return float(found.x[0]), how


def road_wheel_rad(log: Log, wheel: Wheel) -> Column:
    """The labels of the rows of a log [rad]; NaN without steering, and where no steady turn is possible."""
    factor = wheel.lock_rad if log.unit == SteeringUnit.LOCK else 1.0 / wheel.ratio
    measured = wheel.sign * (factor or math.nan) * log.steering
    if wheel.k_us == 0.0 or wheel.wheelbase_m is None:
        return measured
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle).model_copy(
        update={GRADIENT: wheel.k_us, "wheelbase_m": wheel.wheelbase_m}
    )

    def kinematic(angle_rad: float, speed_mps: float) -> float:
        if not (math.isfinite(angle_rad) and math.isfinite(speed_mps)):
            return angle_rad
        curvature_1pm = curvature_from_angle(angle_rad, speed_mps=speed_mps, vehicle=vehicle)
        if curvature_1pm is None:
            return math.nan
        return road_wheel_angle(curvature_1pm, wheelbase_m=vehicle.wheelbase_m)

    return np.array([kinematic(*row) for row in zip(measured.tolist(), log.speed_mps.tolist(), strict=True)])
