"""The simulated vehicle as a node: latest command in, vehicle state and truth out.

The lock-step loop and the vehicle process of a live drive call the same ``step``. The limiter is part of it, next
to the actuator, as in a real vehicle.
"""

import math
from dataclasses import replace

from controller.limiter import Limiter
from sim_harness.lockstep.contact import Outline, separation_m
from sim_harness.lockstep.referee import Place, Referee, locate
from sim_harness.lockstep.road_users import RoadUsersAround, Walker
from sim_harness.lockstep.run_up import drive_along, rail
from sim_harness.lockstep.sensors import NoiseSettings, SimulatedSensors
from sim_harness.lockstep.traffic import Actor, Traffic
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.state import PlantState
from sim_harness.world.roads.middle import followed_road
from sim_harness.world.roads.road import Road
from trepid.car.vehicle import Corridor, Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Command, LeadVehicle, SimTruth, VehicleState
from trepid.types import Positive, Share

_TICK_SLACK = 1e-6  # of a period, so that rounding of now_s does not lose a tick


class SimulatorSettings(NoiseSettings):
    """``config/simulator.yaml``."""

    period_s: Positive
    control_period_s: Positive
    idle_decision_period_s: Positive
    max_offset_m: Positive
    run_up_s: Positive
    lead_range_m: Positive
    lead_sensor_height_m: Positive
    road_user_range_m: Positive
    road_user_seen_share: Share


def load_simulator() -> SimulatorSettings:
    """The simulator settings in ``config/``."""
    return load(CONFIG_DIR / "simulator.yaml", SimulatorSettings)


class SimulatedVehicle:
    """Plant, sensors, limiter, referee and the other vehicles, on the road of a scenario."""

    def __init__(
        self,
        scenario: Scenario,
        road: Road,
        vehicle: Vehicle,
        limiter: Limiter | None,
        settings: SimulatorSettings,
        *,
        seed: int,
    ) -> None:
        """``vehicle`` is the nominal vehicle; the scenario holds the deviations of its plant.

        Without ``limiter`` commands take effect as they are: behind a wire, whose near end has the limiter.
        """
        self.road = road = _line_of(vehicle, road, scenario)
        self._plant = build_plant(scenario.plant, vehicle, seed=seed)
        self._vehicle = self._plant.vehicle
        self.nominal = vehicle
        """The vehicle by its file."""
        self.wheelbase_m = self._vehicle.wheelbase_m
        self._limiter = limiter
        self._settings, self._period_s = settings, settings.period_s
        self.sensors = SimulatedSensors(
            settings, scenario.faults, vehicle, seed=seed, checked=limiter is not None
        )
        self._referee = Referee(road, self._vehicle, max_offset_m=settings.max_offset_m)
        self.nose_m = self._vehicle.wheelbase_m + self._vehicle.front_overhang_m  # from the rear axle
        self._route_end_m = scenario.start.station_m + scenario.route_m(road)
        self._start = scenario.start
        self._run_up_ticks = round(settings.run_up_s / settings.period_s) if scenario.start.speed_mps else 0
        self._ticks = -self._run_up_ticks  # periods since t = 0
        self._pose, self._place = self._first()
        nose_m = scenario.start.station_m + self.nose_m
        self._traffic = Traffic(scenario.traffic, road, nose_m=nose_m, elapsed_s=self._run_time_s)
        self._users = RoadUsersAround(scenario.road_users, road, nose_m=nose_m, elapsed_s=self._run_time_s)
        self._origin_s: float | None = None  # t = 0 of the run
        self._applied: Command | None = None  # output of the limiter, held by the actuators

    def step(
        self, command: Command | None, received_s: float | None, *, now_s: float
    ) -> tuple[VehicleState, SimTruth]:
        """Advance in whole periods up to ``now_s`` under the last applied command, then apply ``command``.

        ``received_s`` is the time of arrival of ``command``. The first call does not advance: it begins the run-up
        of a start at speed, else the run.
        """
        period_s = self._period_s
        if self._origin_s is None:
            self._origin_s = now_s + self._run_up_ticks * period_s
        due = math.floor((now_s - self._origin_s) / period_s + _TICK_SLACK)
        while self._ticks < due and self._applied is not None:
            self._advance(self._applied)
        state = self._measure()
        if self._limiter is None:
            self._applied = command
            return state, self._truth()
        held = self.sensors.drop_doubted(state, self._applied, driver=self._limiter.handed_over, now_s=now_s)
        self._applied = self._limiter.step(command, received_s, held, now_s=now_s)
        return self._limiter.report(held), self._truth()

    def stop(self) -> None:
        """Let the limiter stop the car, latched until standstill."""
        if self._limiter is not None:
            self._limiter.stopping = True

    def wait(self, *, now_s: float) -> tuple[VehicleState, SimTruth]:
        """State and truth before the run begins, which is the first call of :meth:`step`."""
        self._origin_s = now_s - self._run_time_s
        state, truth = self._measure(), self._truth()
        self._origin_s = None
        return state, replace(truth, elapsed_s=None)

    def sense_lead(self) -> LeadVehicle | None:
        """The vehicle ahead as an exact range sensor measures it, see :meth:`Traffic.measured_lead`."""
        nose_m, settings = self._place.station_m + self.nose_m, self._settings
        reach = dict(range_m=settings.lead_range_m, height_m=settings.lead_sensor_height_m)
        return self._traffic.measured_lead(self.box, nose_m=nose_m, t_s=self.now_s, **reach)

    @property
    def others(self) -> list[Actor]:
        """The other vehicles."""
        return self._traffic.actors

    @property
    def road_users(self) -> list[Walker]:
        """The people, cyclists and animals."""
        return self._users.walkers

    @property
    def _run_time_s(self) -> float:
        """Time of the run; negative in the run-up."""
        return self._ticks * self._period_s

    @property
    def now_s(self) -> float:
        """Time of the newest state."""
        return (self._origin_s or 0.0) + self._run_time_s

    def _advance(self, applied: Command) -> None:
        """One period of all motion, then the referee's judgement."""
        period_s, nose_m = self._period_s, self._place.station_m + self.nose_m
        self._traffic.step(self._run_time_s, period_s, nose_m=nose_m)
        self._users.step(self._run_time_s, period_s, nose_m=nose_m)
        self._ticks += 1
        _stand_at(self._plant, self.road, self._place.station_m)
        if self._ticks <= 0:
            self._step_run_up()
        else:
            self._pose = self._plant.step(self._pose, applied, period_s)
            near_m = self._place.station_m + self._pose.speed_mps * period_s
            self._place = locate(self.road, self._pose, near_m)
            if self._referee.must_recentre(self._pose, self._place):
                self._place = Place(self._place.station_m, 0.0, 0.0)
                self._pose = self._recentre(self._pose, self._place)
                self.sensors.restart()
        self._touch()

    def _touch(self) -> None:
        """Count contacts; a vehicle ahead in contact limits the speed to its own, a person or animal does not."""
        boxes = [actor.box for actor in self._traffic.actors]
        everyone = [*boxes, *(walker.box for walker in self._users.walkers)]
        separations_m = [separation_m(self.box, box) for box in everyone]
        self._referee.judge_contacts(separations_m)
        for actor, box, separation in zip(self._traffic.actors, boxes, separations_m, strict=False):
            middle_m = self.box.in_axes(*box.at((box.rear_m + box.front_m) / 2))[0]
            if separation <= 0.0 and middle_m > self._vehicle.wheelbase_m / 2:
                along_mps = actor.speed_mps * math.cos(box.yaw_rad - self._pose.yaw_rad)
                speed_mps = min(self._pose.speed_mps, max(0.0, along_mps))
                self._pose = replace(self._pose, speed_mps=speed_mps)

    @property
    def box(self) -> Outline:
        """The outline of the car on the ground."""
        pose, vehicle = self._pose, self._vehicle
        return Outline(
            pose.x_m, pose.y_m, pose.yaw_rad, -vehicle.rear_overhang_m, self.nose_m, vehicle.track_m
        )

    def _first(self) -> tuple[PlantState, Place]:
        """The first pose: at rest at the start, or rolling towards it."""
        start = self._start
        _stand_at(self._plant, self.road, start.station_m)
        if not self._run_up_ticks:
            place = Place(start.station_m, start.offset_m, start.heading_rad)
            pose = self._move_to(self._plant.initial(), place)
            return pose, locate(self.road, pose, start.station_m)
        here = rail(start, self.road, self._run_time_s)
        place = Place(here.station_m, here.offset_m, here.course_rad)
        rolling = self._plant.initial(speed_mps=start.speed_mps, curvature_1pm=here.curvature_1pm)
        return self._move_to(rolling, place), place

    def _step_run_up(self) -> None:
        """One period of the run-up, in which a driver steers along the rail."""
        here = rail(self._start, self.road, self._run_time_s)
        pose = drive_along(self._plant, self._pose, here, self._settings.period_s, self._start.speed_mps)
        self._place = Place(here.station_m, here.offset_m, here.course_rad)
        self._pose = self._move_to(pose, self._place)

    def _move_to(self, pose: PlantState, place: Place) -> PlantState:
        """``pose`` moved to ``place``."""
        x_m, y_m = self.road.position(place.station_m, place.offset_m)
        yaw_rad = self.road.heading_at(place.station_m) + place.heading_error_rad
        return replace(pose, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)

    def _recentre(self, pose: PlantState, place: Place) -> PlantState:
        """``pose`` moved to ``place`` at the same speed, with the wheels steered along the lane."""
        curvature_1pm = self.road.curvature_at(place.station_m)
        angle_rad = self._plant.steady_angle_rad(curvature_1pm, pose.speed_mps)
        pose = replace(
            pose, road_wheel_angle_rad=angle_rad, acting_demand_rad=angle_rad, pending=(), inner=()
        )
        return self._move_to(pose, place)

    def _measure(self) -> VehicleState:
        """The sensor readings; a driver steers in the run-up."""
        true = replace(self._plant.measure(self._pose, self.now_s), driver_override=self._ticks < 0)
        return self.sensors.measure(true, elapsed_s=self._run_time_s)

    def _truth(self) -> SimTruth:
        pose, (station_m, offset_m, heading_error_rad) = self._pose, self._place
        referee, traffic, users = self._referee, self._traffic.snapshot(), self._users.places()
        lead = self._traffic.ahead(station_m + self.nose_m) if self._traffic.actors else None
        lead_x_m, lead_y_m, lead_yaw_rad = lead[0].pose if lead else (None, None, None)
        return SimTruth(
            t_s=self.now_s,
            x_m=pose.x_m,
            y_m=pose.y_m,
            yaw_rad=pose.yaw_rad,
            station_m=station_m,
            lateral_offset_m=offset_m,
            heading_error_rad=heading_error_rad,
            curvature_1pm=self.road.curvature_at(station_m),
            lane_width_m=self.road.width_at(station_m),
            lateral_accel_mps2=self._plant.lateral_accel_mps2(pose),
            longitudinal_accel_mps2=self._plant.longitudinal_accel_mps2(pose),
            departures=referee.departures,
            interventions=referee.interventions,
            collisions=referee.collisions,
            section=self.road.section_at(station_m).name,
            lead_gap_m=lead[1] if lead else None,
            lead_x_m=lead_x_m,
            lead_y_m=lead_y_m,
            lead_yaw_rad=lead_yaw_rad,
            finished=station_m >= self._route_end_m,
            elapsed_s=self._run_time_s,
            speed_mps=pose.speed_mps,
            yaw_rate_radps=self._plant.yaw_rate_radps(pose),
            traffic_x_m=traffic.x_m,
            traffic_y_m=traffic.y_m,
            traffic_yaw_rad=traffic.yaw_rad,
            traffic_speed_mps=traffic.speed_mps,
            manoeuvres=traffic.manoeuvres + users.manoeuvres,
            user_x_m=users.x_m,
            user_y_m=users.y_m,
            user_yaw_rad=users.yaw_rad,
            user_speed_mps=users.speed_mps,
        )


def _line_of(vehicle: Vehicle, road: Road, scenario: Scenario) -> Road:
    """``road`` with the offsets of the corridor of ``vehicle``, from its lane or the middle of the road.

    Raises InputError for a corridor that the scenario does not have.
    """
    if vehicle.corridor is Corridor.ROAD and (scenario.traffic or scenario.road_users):
        raise InputError(
            f"scenario {scenario.name}: has other vehicles or people, and corridor: road of vehicle.yaml is for"
            " closed paths of a single vehicle"
        )
    return followed_road(road, vehicle)


def _stand_at(plant: Plant, road: Road, station_m: float) -> None:
    """Give the plant the grade and the bank of the road there."""
    if not road.flat:
        plant.stand_on(road.grade_at(station_m), road.bank_at(station_m))
