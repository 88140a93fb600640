"""A vehicle, commands, and the simulation of a plant over time."""

from trepid.config import CONFIG_DIR, load
from trepid.messages import Command
from trepid.vehicle import Vehicle

SHUTTLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def command(angle_rad=0.0, accel_mps2=0.0):
    return Command(
        t_s=0.0,
        road_wheel_angle_rad=angle_rad,
        road_wheel_rate_radps=0.0,
        speed_mps=0.0,
        accel_mps2=accel_mps2,
        jerk_mps3=0.0,
    )


def drive(plant, state, demand, seconds, dt_s=0.01):
    for _ in range(round(seconds / dt_s)):
        state = plant.step(state, demand, dt_s)
    return state
