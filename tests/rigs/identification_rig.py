"""Drives of simulated cars with known truth, as identification reads them."""

import math

import numpy as np
import pytest
from car_rig import Car
from controller_rig import SETTINGS
from message_rig import state, vehicle

from cockpit.calibration.drive_log import DriveLog
from cockpit.calibration.identification import identify_understeer
from cockpit.calibration.steering_response import identify_response
from controller.steering_learner import SteeringLearner
from trepid.car.vehicle import GRADIENT

PERIOD_S = 0.01
CONTROL_EVERY = 2
SPEED_NOISE, ANGLE_NOISE_RAD, YAW_NOISE_RADPS = 0.002, 0.0005, 0.002
PER_DEG_PER_G = math.radians(1.0) / 9.80665


def weave(t_s, *, lateral_mps2=2.0):
    """Lateral acceleration that a driver goes through: four sines below 0.4 Hz whose sum stays within the given."""
    waves = ((0.05, 0.0, 0.45), (0.11, 1.0, 0.3), (0.23, 2.0, 0.15), (0.37, 4.0, 0.1))
    return lateral_mps2 * sum(share * math.sin(2 * math.pi * hz * t_s + at) for hz, at, share in waves)


def drive(
    *,
    build=Car,
    duration_s=90.0,
    speeds_mps=(3.0, 20.0),
    lateral_mps2=2.0,
    steps_rad=0.0,
    offset_rad=0.0,
    ratio=None,
    seed=1,
    yaw_rate_offset_radps=0.0,
    **fields,
) -> DriveLog:
    """A weave from the one speed up to the other and down again; ``fields`` of the vehicle file are its truth.

    Every 0.7 s the command jumps by ``steps_rad`` to the other side. With ``ratio`` angle and command are those of
    the steering wheel. ``build(vehicle, speed_mps, offset_rad)`` makes the car.
    """
    slow, fast = speeds_mps
    car = build(vehicle(max_road_wheel_rate_radps=3.0, **fields), slow, offset_rad)
    noise = np.random.default_rng(seed).standard_normal((round(duration_s / PERIOD_S), 3))
    rows, angle_rad, accel_mps2 = [], 0.0, 0.0
    for tick, jitter in enumerate(noise):
        t_s = tick * PERIOD_S
        target_mps = slow + (fast - slow) * (1 - abs(2 * t_s / duration_s - 1))
        if tick % CONTROL_EVERY == 0:
            curvature_1pm = weave(t_s, lateral_mps2=lateral_mps2) / max(car.speed_mps, 6.0) ** 2
            angle_rad = car.steady_angle_rad(curvature_1pm, max(car.speed_mps, 1.0))
            angle_rad += steps_rad * (-0.5 if t_s % 1.4 < 0.7 else 0.5)
            accel_mps2 = 2.0 * (target_mps - car.speed_mps)
        speed_mps = car.speed_mps * (1 + SPEED_NOISE * jitter[0])
        measured_rad = car.wheel_rad + ANGLE_NOISE_RAD * jitter[1]
        yaw_rate = car.yaw_rate_radps + YAW_NOISE_RADPS * jitter[2]
        rows.append((t_s, speed_mps, measured_rad, yaw_rate, angle_rad))
        car.step(angle_rad, accel_mps2, PERIOD_S)
    t, v, angle, yaw_rate, given = np.array(rows).T
    gear = ratio or 1.0
    return DriveLog(
        t_s=t,
        speed_mps=v,
        angle_rad=angle * gear,
        yaw_rate_radps=yaw_rate + yaw_rate_offset_radps,
        driver_override=np.zeros_like(t),
        at_steering_wheel=ratio is not None,
        command_t_s=t,
        command_rad=given * gear,
    )


def check_recovered(deg_per_g, offset, delay, lag, ratio, zero, build=Car):
    """Identify a car; every parameter must be within 5 % of its truth."""
    log = drive(
        build=build,
        offset_rad=offset,
        ratio=ratio,
        steps_rad=0.01,
        yaw_rate_offset_radps=zero,
        understeer_gradient_rad_per_mps2=deg_per_g * PER_DEG_PER_G,
        steering_delay_s=delay,
        steering_lag_s=lag,
    )
    known = vehicle(max_road_wheel_rate_radps=3.0)
    steady, response = identify_understeer(log, known), identify_response(log, known)
    assert (steady.refused, response.refused) == (None, None)
    found = {name: p.value for name, p in {**steady.parameters, **response.parameters}.items()}
    truth = pytest.approx
    assert found[GRADIENT] == truth(deg_per_g * PER_DEG_PER_G, rel=0.05, abs=0.05 * PER_DEG_PER_G)
    assert found["steering_offset_rad"] == truth(offset, rel=0.05, abs=0.0002)  # 0.01 deg
    assert found["steering_delay_s"] == truth(delay, rel=0.05)
    assert found["steering_lag_s"] == truth(lag, rel=0.05)
    assert found["yaw_rate_offset_radps"] == truth(zero, abs=0.001)
    assert found.get("steering_ratio") == (None if ratio is None else truth(ratio, rel=0.05))


def learn_from(log, learner=None):
    """A learner stepped with every other state of ``log``, as in a controller at 50 Hz."""
    one = learner or SteeringLearner(vehicle(max_road_wheel_rate_radps=3.0), SETTINGS.learning)
    for t, v, angle, rate in zip(log.t_s, log.speed_mps, log.angle_rad, log.yaw_rate_radps, strict=True):
        if round(t * 100) % 2 == 0:
            at, speed, angle_rad, yaw = map(float, (t, v, angle, rate))
            one.step(state(at, speed_mps=speed, road_wheel_angle_rad=angle_rad, yaw_rate_radps=yaw))
    return one


def check_learned(deg_per_g, offset_rad, build=Car):
    """Learn a car while it weaves; understeer and offset must be those of truth and identification."""
    gradient = deg_per_g * PER_DEG_PER_G
    log = drive(build=build, offset_rad=offset_rad, understeer_gradient_rad_per_mps2=gradient)
    one = learn_from(log)
    of_log = identify_understeer(log, vehicle(max_road_wheel_rate_radps=3.0)).parameters
    assert one.understeer == pytest.approx(gradient, rel=0.05)
    assert one.offset_rad == pytest.approx(offset_rad, abs=5e-4)
    assert one.understeer == pytest.approx(of_log[GRADIENT].value, rel=0.05)
    assert one.offset_rad == pytest.approx(of_log["steering_offset_rad"].value, abs=5e-4)
