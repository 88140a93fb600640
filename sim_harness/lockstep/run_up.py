"""The seconds before t = 0 of a run that starts at speed: a driver drives, and hands over at t = 0.

A driver brings the car to the place, heading and speed of the scenario, with the camera and every node running; the
vehicle reports ``driver_override`` until t = 0. The car follows a rail exactly, with the steady steering angle for
its curvature. A lateral drift grows over the last ``DRIFT_S`` as v_y(τ) = v_y·(3τ² - 2τ³), so that the steering is
straight at the hand-over.
"""

import math
from dataclasses import dataclass, replace

from sim_harness.scenarios.scenario import Start
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.state import PlantState
from sim_harness.world.roads.road import Road
from trepid.messages import Command

DRIFT_S = 1.5


@dataclass(frozen=True, slots=True)
class Rail:
    """A point of the driver's path and its curvature."""

    station_m: float
    offset_m: float
    course_rad: float  # relative to the lane
    curvature_1pm: float


def rail(start: Start, road: Road, elapsed_s: float) -> Rail:
    """The point of the path at ``elapsed_s`` ≤ 0.

    The station counts the speed along the lane as v, not v·cos of the course: 0.1 % at a course of 0.05 rad.
    """
    station_m = start.station_m + start.speed_mps * elapsed_s
    drift_mps = start.speed_mps * math.sin(start.course_rad)
    t = max(0.0, 1.0 + elapsed_s / DRIFT_S)
    sideways_mps, accel_mps2 = drift_mps * t**2 * (3 - 2 * t), drift_mps * 6 * t * (1 - t) / DRIFT_S
    to_come_m = drift_mps * DRIFT_S * (0.5 - t**3 * (1 - t / 2))
    course_rad = math.asin(sideways_mps / start.speed_mps)
    bend_1pm = accel_mps2 / (start.speed_mps**2 * math.cos(course_rad))
    return Rail(station_m, start.offset_m - to_come_m, course_rad, road.curvature_at(station_m) + bend_1pm)


def drive_along(plant: Plant, state: PlantState, rail: Rail, dt_s: float, speed_mps: float) -> PlantState:
    """The plant after the driver has steered for ``rail`` over ``dt_s``; the caller sets its place."""
    angle_rad = plant.steady_angle_rad(rail.curvature_1pm, speed_mps)
    command = Command(
        t_s=None,
        road_wheel_angle_rad=angle_rad,
        speed_mps=speed_mps,
        accel_mps2=0.0,
    )
    return replace(plant.step(state, command, dt_s), speed_mps=speed_mps, accel_mps2=0.0)
