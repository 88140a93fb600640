"""One closed loop on a known lane: true state, the controller, a plant that differs from the vehicle file.

There is no rendering, no supervisor and no limiter: every frame gives the true lane as a decision in mode KEEP,
delayed, and with noise if set. So the results are those of the law alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from controller.controller import Controller, ControllerSettings
from perception.lane.settings import steering_settings
from sim_harness.lockstep.oracle import LOOKAHEAD_S
from sim_harness.world.plants.build import build_plant, real_vehicle
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.bounds import at_least
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import Command, Decision, Mode, Stop, VehicleState
from trepid.types import Column

TICK_S = 0.01  # of the vehicle, as in config/simulator.yaml
CONTROL_EVERY, FRAME_EVERY = 2, 4  # ticks: 50 Hz, 25 Hz
LATENCY_S = 0.04  # from the frame to its decision
# Validity of the clothoid that touches the road: least distance, and time.
SIGHT_M, SIGHT_S = steering_settings().lookahead_m, LOOKAHEAD_S
TANGENT_M = 0.01  # over which the rate of the curvature at the axle is taken
S_DURATION_S = 13.0  # of the S
SETTLED_S = 5.0  # after which an offset is no longer that of the start
LOST_M = 5.0  # beyond this offset the lane counts as lost, and the episode ends


@dataclass(frozen=True, kw_only=True)
class Episode:
    """A lane and a car: ``nominal`` is the vehicle file of the controller, ``plant`` the simulated deviation."""

    road: Road
    speed_mps: float
    duration_s: float
    nominal: Vehicle
    plant: PlantSettings = field(default_factory=PlantSettings)
    make_plant: Callable[[Vehicle, PlantSettings], Plant] | None = None  # instead of the model of ``plant``
    frame_every: int = FRAME_EVERY  # ticks
    control_every: int = CONTROL_EVERY
    latency_s: float = LATENCY_S
    offset_noise_m: float = 0.0  # standard deviation of every frame's offset
    # Distance [s] at which the clothoid equals the road, in addition to the axle; None: it touches the road.
    sight_s: float | None = None
    start_m: float = 0.0  # offset at the start
    seed: int = 0


class Steering(Protocol):
    """A controller, or a baseline."""

    def step(self, decision: Decision | None, state: VehicleState | None, *, now_s: float) -> Command:
        """The command for ``now_s``."""
        ...


class Track(NamedTuple):
    """The drive, by tick."""

    offset_m: Column

    @property
    def worst_m(self) -> float:
        """Largest distance from the centre of the lane."""
        return float(np.abs(self.offset_m).max())

    @property
    def settled_offset_m(self) -> float:
        """The largest from ``SETTLED_S`` on; the last offset where the lane was lost before."""
        late_m = self.offset_m[round(SETTLED_S / TICK_S) :]
        return float(np.abs(late_m).max(initial=abs(self.offset_m[-1])))


def road_of(segments: Sequence[tuple[float, float | tuple[float, float]]]) -> Road:
    """Open road of (length [m], curvature [1/m]) pieces."""
    pieces = tuple(Segment(length_m=length, curvature_1pm=curvature) for length, curvature in segments)
    line = {"stroke": "solid"}
    section = {"name": "all", "start_m": 0.0, "left": line, "right": line}
    fields = dict(name="bench", closed=False, lane_width_m=3.5, segments=pieces, sections=(section,))
    return Road(RoadSettings.model_validate(fields))


@cache
def s_clothoid(speed_mps: float, *, lateral_mps2: float = 2.0, jerk_mps3: float = 1.0) -> Road:
    """Two arcs, left and right, 2 s each at ``lateral_mps2``, with entries and exits at ``jerk_mps3``."""
    bend, entry = lateral_mps2 / speed_mps**2, speed_mps * lateral_mps2 / jerk_mps3
    pieces: list[tuple[float, float | tuple[float, float]]] = [(speed_mps, 0.0)]
    for k in (bend, -bend):
        pieces += [(entry, (0.0, k)), (2.0 * speed_mps, k), (entry, (k, 0.0))]
    return road_of([*pieces, (speed_mps, 0.0)])


def s_curve(speed_mps: float, nominal: Vehicle, plant: PlantSettings | None = None, **fields: Any) -> Episode:
    """The S at 2 m/s² on a car that differs from ``nominal`` by ``plant``; ``fields`` of the episode."""
    return Episode(
        road=s_clothoid(speed_mps),
        speed_mps=speed_mps,
        duration_s=S_DURATION_S,
        nominal=nominal,
        plant=plant or PlantSettings(),
        **fields,
    )


def drive(episode: Episode, settings: ControllerSettings) -> Track:
    """Drive ``episode`` with the laws of ``settings``, whose speed planning keeps its speed."""
    any_speed = settings.speed.model_copy(update=dict(lateral_accel_mps2=1e3))
    return drive_by(Controller(episode.nominal, settings.model_copy(update=dict(speed=any_speed))), episode)


def drive_by(steering: Steering, episode: Episode) -> Track:
    """Drive ``episode`` at its speed by ``steering``. Ends early where the lane is lost."""
    plant = _plant_of(episode)
    sight = _Sight(episode)
    road, car = episode.road, plant.initial(y_m=episode.start_m, speed_mps=episode.speed_mps)
    station_m, command, offsets_m = 0.0, None, []
    for tick in range(round(episode.duration_s / TICK_S)):
        now_s = tick * TICK_S
        station_m, offset_m = road.local_coordinates(car.x_m, car.y_m, near_station_m=station_m)
        heading_rad = car.yaw_rad - road.heading_at(station_m)
        measured = plant.measure(car, now_s)
        if tick % episode.frame_every == 0:
            sight.look(now_s, station_m, offset_m, heading_rad)
        if tick % episode.control_every == 0 or command is None:
            command = steering.step(sight.newest_decision(now_s), measured, now_s=now_s)
        offsets_m.append(offset_m)
        if abs(offset_m) > LOST_M:
            break
        car = plant.step(car, replace(command, accel_mps2=0.0), TICK_S)
    return Track(np.array(offsets_m))


def _plant_of(episode: Episode) -> Plant:
    if episode.make_plant is None:
        return build_plant(episode.plant, episode.nominal)
    return episode.make_plant(real_vehicle(episode.plant, episode.nominal), episode.plant)


class _Sight:
    """The true lane with latency."""

    def __init__(self, episode: Episode) -> None:
        self._road, self._speed_mps = episode.road, episode.speed_mps
        self._ahead_m = self._rate_over_m = (episode.sight_s or 0.0) * episode.speed_mps
        if episode.sight_s is None:
            self._ahead_m, self._rate_over_m = at_least(SIGHT_S * episode.speed_mps, SIGHT_M), TANGENT_M
        self._latency_s = episode.latency_s
        self._noise_m = episode.offset_noise_m
        self._generator = np.random.default_rng(episode.seed)
        self._underway: list[Decision] = []

    def look(self, now_s: float, station_m: float, offset_m: float, heading_rad: float) -> None:
        """A frame. The curvature at the axle is that of the road; the clothoid does not show later bends."""
        here, there = (self._road.curvature_at(s) for s in (station_m, station_m + self._rate_over_m))
        rate_1pm2 = (there - here) / self._rate_over_m
        noise_m = self._noise_m * float(self._generator.standard_normal())
        self._underway.append(
            Decision(
                t_s=now_s,
                decided_s=now_s + self._latency_s,
                mode=Mode.KEEP,
                stop=Stop.NONE,
                fear=0.0,
                level="very_low",
                cause="none",
                path_t_s=now_s,
                lateral_offset_m=offset_m + noise_m,
                heading_error_rad=heading_rad,
                curvature_1pm=Lane(offset_m, heading_rad, here, rate_1pm2).curvature_at(self._ahead_m),
                curvature_rate_1pm2=rate_1pm2,
                lookahead_m=self._ahead_m,
                path_source="truth",
                sources=("truth",),
                trust=(1.0,),
                speed_factor=1.0,
                speed_cap_mps=self._speed_mps,
            )
        )

    def newest_decision(self, now_s: float) -> Decision | None:
        """The newest decision available at ``now_s``; the first is available at once."""
        while len(self._underway) > 1 and self._underway[1].decided_s <= now_s + 1e-9:
            self._underway.pop(0)
        return self._underway[0]
