"""People, cyclists and animals in a run: scripted and deterministic, at a station and an offset of the road.

A road user moves along a direction ψ relative to the road: do = v·sin ψ·dt, ds = v·cos ψ·dt / (1 - κ·o). The
distance within a step has a closed form for a constant acceleration; only that quotient is integrated
numerically.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from sim_harness.lockstep.contact import Outline, separation_m
from sim_harness.lockstep.traffic import lane_centre_m, speed_and_distance
from sim_harness.scenarios.road_users import ChangePace, Cross, RoadUser, UserPhase
from sim_harness.world.roads.road import Road

_SAME_INSTANT_S = 1e-9


class Walker:
    """One road user."""

    def __init__(self, settings: RoadUser, road: Road, *, nose_m: float, elapsed_s: float) -> None:
        """``nose_m``: station of the ego front bumper at t = 0; ``elapsed_s`` ≤ 0: the time now."""
        self.figure = settings.figure
        self.speed_mps = settings.speed_mps
        self._road = road
        self._from_m = nose_m + settings.gap_m if settings.gap_m is not None else settings.station_m or 0.0
        self.offset_m = lane_centre_m(road, settings.lane, self._from_m) + settings.offset_m
        self._from_offset_m = self.offset_m
        self._course_rad = settings.facing_rad  # relative to the road
        self.station_m = self._from_m
        self._goal_mps, self._rate_mps2 = self.speed_mps, 1.0
        self._phase: UserPhase | None = None  # under way
        self._goal_offset_m = 0.0  # of a crossing under way
        self._free_s = 0.0  # when the last phase ended
        self._waiting = list(settings.phases)
        self._approach(elapsed_s)

    @property
    def box(self) -> Outline:
        """The outline on the ground."""
        half_m = self.figure.length_m / 2
        return Outline(*self.pose, -half_m, half_m, self.figure.width_m)

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y and yaw of its middle."""
        x_m, y_m = self._road.position(self.station_m, self.offset_m)
        return x_m, y_m, self._road.heading_at(self.station_m) + self._course_rad

    @property
    def manoeuvre(self) -> str | None:
        """The kind of the phase that is under way."""
        return self._phase.kind if self._phase else None

    def step(self, elapsed_s: float, dt_s: float, gap_m: float) -> None:
        """Move from ``elapsed_s`` by ``dt_s``; ``gap_m``: of its middle, ahead of the ego bumper."""
        if elapsed_s < -_SAME_INSTANT_S:
            self._approach(min(0.0, elapsed_s + dt_s))
            return
        while self._waiting and self._begins(self._waiting[0], elapsed_s, gap_m):
            self._begin(self._waiting.pop(0))
        self.speed_mps, distance_m = speed_and_distance(self.speed_mps, self._goal_mps, self._rate_mps2, dt_s)
        self._move(distance_m)
        if isinstance(self._phase, Cross) and self._left_m() <= 0.0:
            self.offset_m, self.speed_mps = self._goal_offset_m, self._phase.then_mps
            self._goal_mps = self.speed_mps
            if self.speed_mps > 0.0:
                self._course_rad = 0.0
            self._phase, self._free_s = None, elapsed_s + dt_s
        elif isinstance(self._phase, ChangePace) and self.speed_mps == self._goal_mps:
            self._phase, self._free_s = None, elapsed_s + dt_s

    def _approach(self, elapsed_s: float) -> None:
        """Before t = 0: at the point from which the place of the scenario is reached at t = 0."""
        back_m = self.speed_mps * min(0.0, elapsed_s)
        self.station_m = self._from_m + back_m * math.cos(self._course_rad)
        self.offset_m = self._from_offset_m + back_m * math.sin(self._course_rad)

    def _begins(self, phase: UserPhase, elapsed_s: float, gap_m: float) -> bool:
        if phase.at_s is not None:
            return elapsed_s >= phase.at_s - _SAME_INSTANT_S
        if phase.at_gap_m is not None:
            return gap_m <= phase.at_gap_m
        after_s = self._free_s + (phase.after_s or 0.0)
        return self._phase is None and elapsed_s >= after_s - _SAME_INSTANT_S

    def _begin(self, phase: UserPhase) -> None:
        self._phase, self._rate_mps2 = phase, phase.rate_mps2
        match phase:
            case ChangePace():
                self._goal_mps = phase.to_mps
            case Cross():
                goal_m = lane_centre_m(self._road, phase.to_lane, self.station_m) + phase.to_offset_m
                side = math.copysign(1.0, goal_m - self.offset_m)
                self._goal_mps, self._goal_offset_m = phase.speed_mps, goal_m
                self._course_rad = side * (math.pi / 2 - phase.lean_rad)

    def _left_m(self) -> float:
        """How far the offset of the crossing under way is still ahead."""
        return (self._goal_offset_m - self.offset_m) * math.copysign(1.0, math.sin(self._course_rad))

    def _move(self, distance_m: float) -> None:
        stretch = 1.0 - self._road.curvature_at(self.station_m) * self.offset_m
        self.station_m += distance_m * math.cos(self._course_rad) / stretch
        self.offset_m += distance_m * math.sin(self._course_rad)


class Places(NamedTuple):
    """All road users at one instant: the fields of SimTruth, one item a road user."""

    x_m: tuple[float, ...] = ()
    y_m: tuple[float, ...] = ()
    yaw_rad: tuple[float, ...] = ()
    speed_mps: tuple[float, ...] = ()
    manoeuvres: tuple[str, ...] = ()


class RoadUsersAround:
    """All road users of a run."""

    def __init__(
        self, users: Sequence[RoadUser], road: Road, *, nose_m: float, elapsed_s: float = 0.0
    ) -> None:
        """``nose_m``: station of the ego front bumper at t = 0; ``elapsed_s`` ≤ 0: the time now."""
        self._road = road
        self.walkers = [Walker(user, road, nose_m=nose_m, elapsed_s=elapsed_s) for user in users]

    def step(self, elapsed_s: float, dt_s: float, *, nose_m: float) -> None:
        """Move every road user from ``elapsed_s`` by ``dt_s``."""
        for walker in self.walkers:
            gap_m = walker.station_m - nose_m
            if self._road.closed:
                gap_m = math.remainder(gap_m, self._road.length_m)
            walker.step(elapsed_s, dt_s, gap_m)

    def places(self) -> Places:
        """Poses and speeds, and the kinds of phases that are under way."""
        if not self.walkers:
            return Places()
        x_m, y_m, yaw_rad = zip(*(walker.pose for walker in self.walkers), strict=True)
        speeds_mps = tuple(walker.speed_mps for walker in self.walkers)
        manoeuvres = tuple(walker.manoeuvre for walker in self.walkers if walker.manoeuvre)
        return Places(x_m, y_m, yaw_rad, speeds_mps, manoeuvres)


def nearest_gap_m(ego: Outline, walkers: Sequence[Walker]) -> float | None:
    """The least separation of the ego vehicle from a road user, 0 in contact; None without any."""
    return min((max(separation_m(ego, walker.box), 0.0) for walker in walkers), default=None)
