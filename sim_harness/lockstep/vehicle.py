"""The simulated vehicle as a node: latest command in, vehicle state and truth out.

The lock-step loop and the vehicle process of a live drive call the same ``step``. The limiter stands here, next to
the actuator, as in a real vehicle.
"""

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from controller.limiter import Limiter
from sim_harness.lockstep.referee import LeadPlace, Place, Referee, locate
from sim_harness.plants.kinematic import Plant
from sim_harness.plants.plant import real_vehicle
from sim_harness.plants.state import PlantState
from sim_harness.render.renderer import LEAD
from sim_harness.roads.road import Road
from sim_harness.scenarios.scenario import Scenario
from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import Command, LeadVehicle, SimTruth, VehicleState
from trepid.vehicle import Vehicle

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
_TICK_SLACK = 1e-6  # of a period, so that rounding of now_s does not lose a tick


class SimulatorSettings(Settings):
    """``config/simulator.yaml``."""

    period_s: Positive
    control_period_s: Positive
    idle_decision_period_s: Positive
    speed_noise_ratio: NonNegative
    road_wheel_angle_noise_rad: NonNegative
    yaw_rate_noise_radps: NonNegative
    max_offset_m: Positive


def load_simulator() -> SimulatorSettings:
    """The simulator settings in ``config/``."""
    return load(CONFIG_DIR / "simulator.yaml", SimulatorSettings)


class SimulatedVehicle:
    """Plant, sensors, limiter, referee and the vehicle ahead, on the road of a scenario."""

    def __init__(
        self,
        scenario: Scenario,
        road: Road,
        vehicle: Vehicle,
        limiter: Limiter,
        settings: SimulatorSettings,
        *,
        seed: int,
    ) -> None:
        """``vehicle`` is what the car is believed to be; the scenario says how its plant differs."""
        self._scenario = scenario
        self._road = road
        self._vehicle = real_vehicle(scenario.plant, vehicle)
        self._plant = Plant(self._vehicle)
        self._limiter = limiter
        self._settings = settings
        self._noise = np.random.default_rng((seed, 0))
        self._referee = Referee(road, self._vehicle, max_offset_m=settings.max_offset_m)
        self._nose_m = self._vehicle.wheelbase_m + self._vehicle.front_overhang_m
        self._route_end_m = scenario.start.station_m + scenario.route_m(road)
        start = scenario.start
        place = Place(start.station_m, start.offset_m, start.heading_rad)
        self._pose = self._placed(PlantState(), place)
        self._place = locate(road, self._pose, start.station_m)
        self._origin_s: float | None = None
        self._ticks = 0
        self._applied: Command | None = None  # what the limiter let through last: the actuators hold it

    def step(
        self, command: Command | None, received_s: float | None, *, now_s: float
    ) -> tuple[VehicleState, SimTruth]:
        """Advance in whole periods up to ``now_s`` under what was applied last, then apply ``command``.

        ``received_s`` is when ``command`` arrived. The first call only looks and applies.
        """
        if self._origin_s is None:
            self._origin_s = now_s
        period_s = self._settings.period_s
        due = math.floor((now_s - self._origin_s) / period_s + _TICK_SLACK)
        while self._ticks < due and self._applied is not None:
            self._advance(self._applied)
        state = self._measure()
        self._applied = self._limiter.step(command, received_s, state, now_s=now_s)
        return state, self._truth()

    def sense_lead(self) -> LeadVehicle | None:
        """The vehicle ahead as a range sensor on the front bumper would see it; None without one."""
        lead, size, pose = self._lead(), next(iter(self._scenario.traffic), None), self._pose
        if lead is None or size is None:
            return None
        dx_m, dy_m = lead.rear_m[0] - pose.x_m, lead.rear_m[1] - pose.y_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        return LeadVehicle(
            t_s=self._now_s,
            distance_m=dx_m * cos + dy_m * sin - self._nose_m,
            lateral_m=dy_m * cos - dx_m * sin,
            speed_mps=size.speed_mps,
            confidence=1.0,
        )

    @property
    def _now_s(self) -> float:
        return (self._origin_s or 0.0) + self._ticks * self._settings.period_s

    def _advance(self, applied: Command) -> None:
        """One period of the plant, and the referee's verdict on where it ends."""
        self._pose = self._plant.step(self._pose, applied, self._settings.period_s)
        self._ticks += 1
        self._place = locate(self._road, self._pose, self._place.station_m)
        if self._referee.must_recentre(self._pose, self._place):
            self._place = Place(self._place.station_m, 0.0, 0.0)
            self._pose = self._recentred(self._pose, self._place)
        lead, size = self._lead(), next(iter(self._scenario.traffic), None)
        if lead is not None and size is not None and self._referee.in_contact(self._place, lead):
            self._pose = replace(self._pose, speed_mps=min(self._pose.speed_mps, size.speed_mps))

    def _placed(self, pose: PlantState, place: Place) -> PlantState:
        """``pose`` moved to ``place``."""
        x_m, y_m = self._road.position(place.station_m, place.offset_m)
        yaw_rad = self._road.heading_at(place.station_m) + place.heading_error_rad
        return replace(pose, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)

    def _recentred(self, pose: PlantState, place: Place) -> PlantState:
        """``pose`` put back at ``place`` with the same speed and the wheels along the lane, as a driver would."""
        curvature_1pm = self._road.curvature_at(place.station_m)
        angle_rad = self._plant.steady_angle_rad(curvature_1pm, pose.speed_mps)
        pose = replace(pose, road_wheel_angle_rad=angle_rad, acting_demand_rad=angle_rad, pending=())
        return self._placed(pose, place)

    def _measure(self) -> VehicleState:
        """What the sensors say: white noise, except that a standing wheel is known to stand."""
        pose, settings = self._pose, self._settings
        speed, angle, rate = self._noise.standard_normal(3).tolist()
        return VehicleState(
            t_s=self._now_s,
            speed_mps=pose.speed_mps * (1.0 + settings.speed_noise_ratio * speed),
            road_wheel_angle_rad=pose.road_wheel_angle_rad + settings.road_wheel_angle_noise_rad * angle,
            yaw_rate_radps=self._plant.yaw_rate_radps(pose) + settings.yaw_rate_noise_radps * rate,
            driver_override=False,
        )

    def _lead(self) -> LeadPlace | None:
        """Where the vehicle ahead is now: on the lane centre, at constant speed since the start."""
        lead = next(iter(self._scenario.traffic), None)
        if lead is None or lead.gap_m is None:
            return None
        elapsed_s = self._ticks * self._settings.period_s
        rear_m = self._scenario.start.station_m + self._nose_m + lead.gap_m + lead.speed_mps * elapsed_s
        axle_m = rear_m - LEAD.rear_m
        x_m, y_m = self._road.position(axle_m, 0.0)
        return LeadPlace(
            gap_m=rear_m - self._place.station_m - self._nose_m,
            rear_m=self._road.position(rear_m, 0.0),
            x_m=x_m,
            y_m=y_m,
            yaw_rad=self._road.heading_at(axle_m),
        )

    def _truth(self) -> SimTruth:
        pose, place, lead, referee = self._pose, self._place, self._lead(), self._referee
        return SimTruth(
            t_s=self._now_s,
            x_m=pose.x_m,
            y_m=pose.y_m,
            yaw_rad=pose.yaw_rad,
            station_m=place.station_m,
            lateral_offset_m=place.offset_m,
            heading_error_rad=place.heading_error_rad,
            curvature_1pm=self._road.curvature_at(place.station_m),
            lane_width_m=self._road.width_at(place.station_m),
            lateral_accel_mps2=self._plant.lateral_accel_mps2(pose),
            longitudinal_accel_mps2=pose.accel_mps2,
            departures=referee.departures,
            interventions=referee.interventions,
            collisions=referee.collisions,
            section=self._road.section_at(place.station_m).name,
            lead_gap_m=lead.gap_m if lead else None,
            lead_x_m=lead.x_m if lead else None,
            lead_y_m=lead.y_m if lead else None,
            lead_yaw_rad=lead.yaw_rad if lead else None,
            finished=place.station_m >= self._route_end_m,
        )
