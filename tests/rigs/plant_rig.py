"""A vehicle, commands, and the simulation of a plant over time."""

import message_rig


def command(angle_rad=0.0, accel_mps2=0.0):
    return message_rig.command(road_wheel_angle_rad=angle_rad, speed_mps=0.0, accel_mps2=accel_mps2)


def drive(plant, state, demand, seconds, dt_s=0.01):
    for _ in range(round(seconds / dt_s)):
        state = plant.step(state, demand, dt_s)
    return state
