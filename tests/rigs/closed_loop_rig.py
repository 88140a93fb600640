"""A closed loop of controller, limiter and simulated vehicle on perfect sight."""

import math
from dataclasses import dataclass

from controller_rig import LIMITS, SETTINGS
from message_rig import SHUTTLE, SIGHT_M, decision

from controller.controller import Controller, ControllerSettings
from controller.limiter import Limiter
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.state import PlantState
from sim_harness.world.roads.road import Road
from trepid.car.vehicle import Vehicle
from trepid.messages import Command, Decision

TICK_S = 0.01  # of the vehicle
CONTROL_EVERY, FRAME_EVERY = 2, 4  # ticks: 50 Hz, 25 Hz


@dataclass(frozen=True)
class Sample:
    """The truth at one tick."""

    t_s: float
    station_m: float
    offset_m: float
    heading_rad: float
    plant: PlantState
    command: Command


def drive(
    line: Road,
    *,
    start: PlantState,
    cap_mps: float,
    duration_s: float,
    plant_vehicle: Vehicle = SHUTTLE,
    plant: Plant | None = None,
    known_vehicle: Vehicle | None = None,
    settings: ControllerSettings = SETTINGS,
    sight_delay_s: float = 0.04,
    limited: bool = True,
) -> list[Sample]:
    """Closed loop on perfect but late sight: frame -> decision -> controller -> limiter -> plant."""
    plant = plant or KinematicPlant(plant_vehicle)
    known = known_vehicle or plant.vehicle
    controller, limiter = Controller(known, settings), Limiter(known, LIMITS)
    car, station_m, sent, sent_s = start, 0.0, None, None
    frames: list[Decision] = []
    samples = []
    for tick in range(round(duration_s / TICK_S)):
        now_s = tick * TICK_S
        station_m, offset_m = line.local_coordinates(car.x_m, car.y_m, near_station_m=station_m)
        heading_rad = math.remainder(car.yaw_rad - line.heading_at(station_m), math.tau)
        measured = plant.measure(car, now_s)
        if tick % FRAME_EVERY == 0:
            frames.append(_see(line, now_s, station_m, offset_m, heading_rad, cap_mps, sight_delay_s))
        arrived = [frame for frame in frames if frame.decided_s <= now_s + 1e-9]
        frames = frames[len(arrived) - 1 :] if arrived else frames
        if tick % CONTROL_EVERY == 0:
            sent, sent_s = controller.step(arrived[-1] if arrived else None, measured, now_s=now_s), now_s
        acted = limiter.step(sent, sent_s, measured, now_s=now_s) if limited else sent
        samples.append(Sample(now_s, station_m, offset_m, heading_rad, car, acted))
        car = plant.step(car, acted, TICK_S)
    return samples


def _see(line, now_s, station_m, offset_m, heading_rad, cap_mps, sight_delay_s) -> Decision:
    """The lane at the axle as it is, as a clothoid with the local curvature rate."""
    curvature = line.curvature_at(station_m)
    rate = (line.curvature_at(station_m + 0.01) - curvature) / 0.01
    return decision(
        now_s,
        decided_s=now_s + sight_delay_s,
        lateral_offset_m=offset_m,
        heading_error_rad=heading_rad,
        curvature_1pm=curvature + rate * SIGHT_M,
        curvature_rate_1pm2=rate,
        speed_cap_mps=cap_mps,
    )


def generous(lateral_mps2):
    """Speed planning that leaves the speed alone where the test prescribes it."""
    speed = SETTINGS.speed.model_copy(update=dict(lateral_accel_mps2=lateral_mps2))
    return SETTINGS.model_copy(update=dict(speed=speed))


def worst_m(samples):
    return max(abs(one.offset_m) for one in samples)
