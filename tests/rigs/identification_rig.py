"""Drives of simulated cars with known truth, as identification reads them."""

import math

import numpy as np
from message_rig import vehicle

from controller.identify.drive_log import DriveLog
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import PlantSettings
from trepid.messages import Command

PERIOD_S = 0.01
CONTROL_EVERY = 2
NOISE = load_simulator()
PER_DEG_PER_G = math.radians(1.0) / 9.80665


def weave(t_s, *, lateral_mps2=2.0):
    """Lateral acceleration that a driver goes through: four sines below 0.4 Hz whose sum stays within the given."""
    waves = ((0.05, 0.0, 0.45), (0.11, 1.0, 0.3), (0.23, 2.0, 0.15), (0.37, 4.0, 0.1))
    return lateral_mps2 * sum(share * math.sin(2 * math.pi * hz * t_s + at) for hz, at, share in waves)


def drive(
    *,
    plant="kinematic",
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
    the steering wheel.
    """
    car = vehicle(max_road_wheel_rate_radps=3.0, **fields)
    model = build_plant(PlantSettings(model=plant, steering_offset_rad=offset_rad), car)
    noise = np.random.default_rng(seed).standard_normal((round(duration_s / PERIOD_S), 3))
    slow, fast = speeds_mps
    state, rows, command = model.initial(speed_mps=slow), [], None
    for tick, jitter in enumerate(noise):
        t_s = tick * PERIOD_S
        target_mps = slow + (fast - slow) * (1 - abs(2 * t_s / duration_s - 1))
        if tick % CONTROL_EVERY == 0:
            curvature_1pm = weave(t_s, lateral_mps2=lateral_mps2) / max(state.speed_mps, 6.0) ** 2
            angle_rad = model.steady_angle_rad(curvature_1pm, max(state.speed_mps, 1.0))
            angle_rad += steps_rad * (-0.5 if t_s % 1.4 < 0.7 else 0.5)
            accel_mps2 = 2.0 * (target_mps - state.speed_mps)
            command = Command(
                t_s=None,
                road_wheel_angle_rad=angle_rad,
                speed_mps=target_mps,
                accel_mps2=accel_mps2,
            )
        speed_mps = state.speed_mps * (1 + NOISE.speed_noise_ratio * jitter[0])
        measured_rad = state.road_wheel_angle_rad + NOISE.road_wheel_angle_noise_rad * jitter[1]
        yaw_rate = model.yaw_rate_radps(state) + NOISE.yaw_rate_noise_radps * jitter[2]
        rows.append((t_s, speed_mps, measured_rad, yaw_rate, command.road_wheel_angle_rad))
        state = model.step(state, command, PERIOD_S)
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
