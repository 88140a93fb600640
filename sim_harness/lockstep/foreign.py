"""A world of another package in the lock-step loop: its car, its lane and its pictures.

The loop holds a simulated clock: it reads the state, lets the steps of Trepid compute, and advances the world by
one period of ``config/simulator.yaml``. Recording, judgement and everything that is built on them are those of the
simulator. Entry points of the group ``trepid.worlds`` name worlds; a scenario chooses one by ``world``.
"""

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from controller.limiter import Limiter
from sim_harness.lockstep.contact import Outline
from sim_harness.lockstep.road_users import Walker
from sim_harness.lockstep.sensors import SimulatedSensors
from sim_harness.lockstep.vehicle import SimulatorSettings
from sim_harness.scenarios.scenario import Scenario
from sim_harness.scenarios.world_choice import WorldChoice
from trepid import plugins
from trepid.car.camera import Camera
from trepid.car.vehicle import Corridor, Vehicle
from trepid.config import InputError
from trepid.messages import Command, SimTruth, VehicleState
from trepid.spelling import did_you_mean
from trepid.types import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldState:
    """The car of a world and its place in the lane at one instant, in truth; signs of ISO 8855."""

    x_m: float  # of the centre of the rear axle, as all that follows
    y_m: float
    yaw_rad: float
    speed_mps: float
    yaw_rate_radps: float
    road_wheel_angle_rad: float  # without steered wheels that of the commands, as late as it turns
    station_m: float  # along the centre of the lane, continued over laps
    lateral_offset_m: float
    heading_error_rad: float
    lane_width_m: float
    section: str = ""  # name of the part of the road
    finished: bool = False  # the end of the route is reached


class World(Protocol):
    """A simulator of another package. It has no clock: time passes in :meth:`advance` alone."""

    def state(self) -> WorldState:
        """The present state."""
        ...

    def curvature_at(self, ahead_m: float) -> float:
        """Curvature of the centre of the lane [1/m] ``ahead_m`` further along it than the car, + = bends left."""
        ...

    def picture(self) -> Image:
        """What the camera of ``camera.yaml`` sees now: BGR, uint8, of shape (height_px, width_px, 3)."""
        ...

    def advance(self, command: Command, period_s: float) -> None:
        """Let ``period_s`` pass under ``command``, which the limiter has passed."""
        ...

    def recentre(self) -> None:
        """Put the car on the centre of the lane, along it, at its present speed: the referee intervenes."""
        ...


class CheckedWorld:
    """A world whose states and pictures are checked. Every fault of it raises InputError with its name."""

    def __init__(self, choice: WorldChoice, camera: Camera, vehicle: Vehicle, *, seed: int) -> None:
        self.name = choice.model
        make = plugins.part(plugins.Group.WORLDS, choice.model, {})
        _check_options(make, choice)
        with plugins.beginning(plugins.Group.WORLDS, choice.model):
            self._world: World = make(camera, vehicle, seed=seed, **choice.options)
        self._shape = (camera.height_px, camera.width_px, 3)

    def state(self) -> WorldState:
        """The present state."""
        found = self._ask("state")
        for one in fields(found):
            value = getattr(found, one.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(f"world {self.name!r}: state(): {one.name} is {value}")
        return found

    def curvature_at(self, ahead_m: float) -> float:
        """See :meth:`World.curvature_at`."""
        found = self._ask("curvature_at", ahead_m, of=float)
        if not math.isfinite(found):
            raise InputError(f"world {self.name!r}: curvature_at({ahead_m:g}) is {found}")
        return found

    def picture(self) -> Image:
        """The present picture."""
        image = self._ask("picture", of=np.asarray)
        if image.shape != self._shape or image.dtype != np.uint8:
            raise InputError(
                f"world {self.name!r}: picture() is {image.dtype} of shape {image.shape}; camera.yaml has uint8 of"
                f" shape {self._shape}"
            )
        return np.ascontiguousarray(image)

    def advance(self, command: Command, period_s: float) -> None:
        """See :meth:`World.advance`."""
        self._ask("advance", command, period_s)

    def recentre(self) -> None:
        """See :meth:`World.recentre`."""
        self._ask("recentre")

    def _ask(self, method: str, *given: object, of: Callable[[Any], Any] | None = None) -> Any:
        """What a method of the world returns, converted by ``of``."""
        try:
            found = getattr(self._world, method)(*given)
            return found if of is None else of(found)
        except Exception as error:  # the code of another package
            raise InputError(f"world {self.name!r}: {method}(): {type(error).__name__}: {error}") from error


def _check_options(make: Any, choice: WorldChoice) -> None:
    """Raise InputError for an option that the world does not know."""
    known = inspect.signature(make).parameters
    if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in known.values()):
        return
    names = [
        name for name, one in known.items() if one.kind is inspect.Parameter.KEYWORD_ONLY and name != "seed"
    ]
    for name in choice.options:
        if name not in names:
            raise InputError(f"world {choice.model!r}: unknown option {name!r}; {did_you_mean(name, names)}")


class WorldLane:
    """The lane of a world where the loop asks for a road."""

    closed, length_m = False, math.inf

    def __init__(self, world: CheckedWorld) -> None:
        self._world = world

    def curvature_at(self, station_m: float) -> float:
        """Curvature of the centre of the lane [1/m]."""
        return self._world.curvature_at(station_m - self._world.state().station_m)


class WorldPictures:
    """The pictures of a world where the camera asks for a renderer."""

    road = None

    def __init__(self, world: CheckedWorld, seed: int) -> None:
        self._world, self.seed = world, seed

    def render(self, *_pose: float, **_scene: object) -> Image:
        """The present picture, whatever the pose: the world knows it."""
        return self._world.picture()


class WorldVehicle:
    """The car of a world as a node: command in, vehicle state and truth out, the limiter before the actuator."""

    others: Sequence[Any] = ()
    road_users: Sequence[Walker] = ()

    def __init__(
        self,
        scenario: Scenario,
        world: CheckedWorld,
        vehicle: Vehicle,
        limiter: Limiter,
        settings: SimulatorSettings,
        *,
        seed: int,
    ) -> None:
        if vehicle.corridor is Corridor.ROAD:
            raise InputError(
                "corridor: road of vehicle.yaml: a world of another package has a lane and no middle of the road"
            )
        self.road, self.nominal, self.wheelbase_m = WorldLane(world), vehicle, vehicle.wheelbase_m
        self.nose_m = vehicle.wheelbase_m + vehicle.front_overhang_m
        self._world, self._limiter, self._settings = world, limiter, settings
        self.sensors = SimulatedSensors(settings, scenario.faults, vehicle, seed=seed, checked=True)
        self._route_m = scenario.distance_m or math.inf
        self._applied: Command | None = None
        self._before = self._state = world.state()
        self._first_m = self._state.station_m
        self._origin_s: float | None = None
        self._departures = self._interventions = 0

    def step(
        self, command: Command | None, received_s: float | None, *, now_s: float
    ) -> tuple[VehicleState, SimTruth]:
        """Advance by one period under the last applied command, then apply ``command``.

        ``received_s`` is the time of its arrival. The first call does not advance.
        """
        if self._origin_s is None:
            self._origin_s = now_s
        elif self._applied is not None:
            self._advance(self._applied)
        true = self._state
        measured = VehicleState(
            t_s=now_s,
            speed_mps=true.speed_mps,
            road_wheel_angle_rad=true.road_wheel_angle_rad,
            yaw_rate_radps=true.yaw_rate_radps,
            driver_override=False,
        )
        state = self.sensors.measure(measured, elapsed_s=now_s - self._origin_s)
        held = self.sensors.drop_doubted(state, self._applied, driver=self._limiter.handed_over, now_s=now_s)
        self._applied = self._limiter.step(command, received_s, held, now_s=now_s)
        return self._limiter.report(held), self._truth(now_s)

    def sense_lead(self) -> None:
        """No sensor of vehicles ahead: ``lead_sensor: camera`` looks for them in the pictures."""

    @property
    def box(self) -> Outline:
        """The outline of the car on the ground."""
        true, vehicle = self._state, self.nominal
        return Outline(
            true.x_m, true.y_m, true.yaw_rad, -vehicle.rear_overhang_m, self.nose_m, vehicle.track_m
        )

    def _advance(self, applied: Command) -> None:
        """One period of the world, then the referee's judgement, as :class:`.referee.Referee` counts."""
        self._world.advance(applied, self._settings.period_s)
        self._before, self._state = self._state, self._world.state()
        departed = wheel_outside(self._state, self.nominal, self.road.curvature_at(self._state.station_m))
        self._departures += departed
        if departed or abs(self._state.lateral_offset_m) > self._settings.max_offset_m:
            self._interventions += 1
            self._world.recentre()
            self._state = self._world.state()
            self.sensors.restart()

    def _truth(self, now_s: float) -> SimTruth:
        true, origin_s = self._state, self._origin_s or 0.0
        rise_mps = true.speed_mps - self._before.speed_mps
        return SimTruth(
            t_s=now_s,
            x_m=true.x_m,
            y_m=true.y_m,
            yaw_rad=true.yaw_rad,
            station_m=true.station_m,
            lateral_offset_m=true.lateral_offset_m,
            heading_error_rad=true.heading_error_rad,
            curvature_1pm=self.road.curvature_at(true.station_m),
            lane_width_m=true.lane_width_m,
            lateral_accel_mps2=true.speed_mps * true.yaw_rate_radps,
            longitudinal_accel_mps2=rise_mps / self._settings.period_s,
            departures=self._departures,
            interventions=self._interventions,
            collisions=0,
            section=true.section,
            lead_gap_m=None,
            lead_x_m=None,
            lead_y_m=None,
            lead_yaw_rad=None,
            finished=true.finished or true.station_m - self._first_m >= self._route_m,
            elapsed_s=now_s - origin_s,
            speed_mps=true.speed_mps,
            yaw_rate_radps=true.yaw_rate_radps,
        )


def wheel_outside(state: WorldState, vehicle: Vehicle, curvature_1pm: float) -> bool:
    """True when the outer edge of a wheel is over the edge of the lane, on the arc through the rear axle.

    The front axle is L·sin(heading error) - κ·L²/2 further to the left than the rear axle.
    """
    half_m = vehicle.track_m / 2 * math.cos(state.heading_error_rad)
    ahead_m = vehicle.wheelbase_m * math.cos(state.heading_error_rad)
    front_m = (
        state.lateral_offset_m
        + vehicle.wheelbase_m * math.sin(state.heading_error_rad)
        - curvature_1pm * ahead_m**2 / 2
    )
    return max(abs(state.lateral_offset_m), abs(front_m)) + half_m > state.lane_width_m / 2
