"""A plant on its own: a step of the wheel angle, and the lateral acceleration after it."""

from typing import Any

from trepid.messages import Command


def step_response_mps2(plant: Any, angle_rad: float, *, speed_mps: float, steps: int) -> list[float]:
    """Lateral acceleration by tick of 10 ms after a step of the wheel angle."""
    state, found = plant.initial(speed_mps=speed_mps), []
    command = Command(t_s=0.0, road_wheel_angle_rad=angle_rad, speed_mps=speed_mps, accel_mps2=0.0)
    for _ in range(steps):
        state = plant.step(state, command, 0.01)
        found.append(plant.yaw_rate_radps(state) * speed_mps)
    return found
