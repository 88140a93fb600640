"""Other vehicles in a run: scripted, deterministic, on the road or off it.

On the road a vehicle is at a station and an offset; its rear axle moves along the road at its speed, on an offset
line of a bend by ds = v·dt/(1 - κ·o). A turn-off is an arc, then a straight, in the plane. Both have closed forms
for a constant acceleration, so only that quotient is integrated numerically.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from sim_harness.lockstep.contact import Outline
from sim_harness.lockstep.referee import foot_point
from sim_harness.scenarios.traffic import ChangeLane, ChangeSpeed, Phase, TrafficVehicle, TurnOff
from sim_harness.world.roads.lanes import RoadLane
from sim_harness.world.roads.road import Road
from sim_harness.world.sight_lines import SightLines, Spot
from trepid.messages import LeadVehicle

INTO_LANE_M = 0.3
"""A vehicle that reaches this far over the edge of the ego lane is in the lane: UN R157, 5.2.5.2 (cut-in)."""
GONE_M = 40.0  # beyond this distance from the road a vehicle is no longer located on it
MOVING_MPS = 0.01  # a vehicle that stands does not slide sideways
_SAME_INSTANT_S = 1e-9


class Actor:
    """One other vehicle."""

    def __init__(self, settings: TrafficVehicle, road: Road, *, nose_m: float, elapsed_s: float) -> None:
        """``nose_m``: station of the ego front bumper at t = 0; ``elapsed_s`` ≤ 0: the time now."""
        self.body = settings.body
        self.speed_mps = settings.speed_mps
        self._road = road
        self._forwards = -1 if settings.oncoming else 1
        self._origin_m = settings.station_m or 0.0
        if settings.gap_m is not None:
            near_end_m = self.body.front_m if settings.oncoming else -self.body.rear_m
            self._origin_m = nose_m + settings.gap_m + near_end_m
        self.offset_m = lane_centre_m(road, settings.lane, self._origin_m) + settings.offset_m
        self.station_m = self._origin_m + self._forwards * self.speed_mps * elapsed_s
        self._sideways_mps = 0.0
        self._goal_mps, self._rate_mps2 = self.speed_mps, 1.0
        self._change: ChangeLane | None = None
        self._change_from_m, self._change_by_m, self._changing_s = 0.0, 0.0, 0.0
        self._free: tuple[float, float, float] | None = None  # x, y, yaw off the road
        self._turn_1pm, self._turn_left_rad = 0.0, 0.0
        self._waiting = list(settings.phases)
        self._short: float | None = None  # distance to the next phase's trigger at its first check

    @property
    def box(self) -> Outline:
        """The outline on the ground."""
        x_m, y_m, yaw_rad = self.pose
        return Outline(x_m, y_m, yaw_rad, self.body.rear_m, self.body.front_m, self.body.width_m)

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y and yaw of its rear axle."""
        if self._free is not None:
            return self._free
        x_m, y_m = self._road.position(self.station_m, self.offset_m)
        return x_m, y_m, self._road.heading_at(self.station_m) + self._course_rad

    @property
    def _course_rad(self) -> float:
        """Heading relative to the road."""
        return math.atan2(self._sideways_mps, self._forwards * max(self.speed_mps, MOVING_MPS))

    @property
    def manoeuvres(self) -> list[str]:
        """The kinds of phases that are under way."""
        under_way = {
            "change_speed": self.speed_mps != self._goal_mps,
            "change_lane": self._change is not None,
            "turn_off": self._turn_left_rad > 0.0,
        }
        return [kind for kind, is_so in under_way.items() if is_so]

    def ends(self) -> list[tuple[float, float]] | None:
        """(station, offset) of the middles of the rear and front end; None when the vehicle has left the road."""
        lengths_m = (self.body.rear_m, self.body.front_m)
        if self._free is None:
            cos, sin = math.cos(self._course_rad), math.sin(self._course_rad)
            return [(self.station_m + x * cos, self.offset_m + x * sin) for x in lengths_m]
        if abs(self.offset_m) > GONE_M:
            return None
        return [foot_point(self._road, *self.box.at(x), self.station_m)[:2] for x in lengths_m]

    def step(self, elapsed_s: float, dt_s: float, gap_m: float | None) -> None:
        """Move from ``elapsed_s`` by ``dt_s``; ``gap_m``: from the ego bumper, None off the road."""
        if elapsed_s < -_SAME_INSTANT_S:  # before t = 0 every vehicle rolls towards its start
            ahead_s = min(0.0, elapsed_s + dt_s)
            self.station_m = self._origin_m + self._forwards * self.speed_mps * ahead_s
            return
        while self._waiting and self._begins(self._waiting[0], elapsed_s, gap_m):
            self._begin(self._waiting.pop(0))
            self._short = None
        self.speed_mps, distance_m = speed_and_distance(self.speed_mps, self._goal_mps, self._rate_mps2, dt_s)
        if self._free is None:
            self._roll(distance_m, dt_s)
        else:
            self._free = self._roll_free(*self._free, distance_m)

    def _begins(self, phase: Phase, elapsed_s: float, gap_m: float | None) -> bool:
        if phase.at_s is not None:
            return elapsed_s >= phase.at_s - _SAME_INSTANT_S
        here, mark = (
            (gap_m, phase.at_gap_m) if phase.at_station_m is None else (self.station_m, phase.at_station_m)
        )
        if here is None or mark is None:
            return False
        if self._short is None:
            self._short = mark - here
        return (mark - here) * self._short <= 0.0

    def _begin(self, phase: Phase) -> None:
        match phase:
            case ChangeSpeed():
                self._goal_mps, self._rate_mps2 = phase.to_mps, phase.rate_mps2
            case ChangeLane():
                self._change, self._change_from_m, self._changing_s = phase, self.offset_m, 0.0
                goal_m = lane_centre_m(self._road, phase.to_lane, self.station_m) + phase.to_offset_m
                self._change_by_m = goal_m - self.offset_m
            case TurnOff():
                self._free = self.pose
                self._turn_1pm = (1 if phase.side == "left" else -1) / phase.radius_m
                self._turn_left_rad = phase.angle_rad
                self._change = None

    def _roll(self, distance_m: float, dt_s: float) -> None:
        """Along the road, and across it while the lane changes."""
        stretch = 1.0 - self._road.curvature_at(self.station_m) * self.offset_m
        self.station_m += self._forwards * distance_m / stretch
        if self._change is None or distance_m <= 0.0:
            self._sideways_mps = 0.0
            return
        self._changing_s += dt_s
        share, slope = least_jerk(self._changing_s / self._change.over_s)
        self.offset_m = self._change_from_m + self._change_by_m * share
        self._sideways_mps = self._change_by_m * slope / self._change.over_s
        if self._changing_s >= self._change.over_s - _SAME_INSTANT_S:
            self._change = None

    def _roll_free(
        self, x_m: float, y_m: float, yaw_rad: float, distance_m: float
    ) -> tuple[float, float, float]:
        """The pose after ``distance_m`` along the arc while it lasts, then straight on."""
        arc_m = min(distance_m, self._turn_left_rad / abs(self._turn_1pm))
        turned_rad = yaw_rad + self._turn_1pm * arc_m
        x_m += (math.sin(turned_rad) - math.sin(yaw_rad)) / self._turn_1pm
        y_m -= (math.cos(turned_rad) - math.cos(yaw_rad)) / self._turn_1pm
        self._turn_left_rad = max(0.0, self._turn_left_rad - abs(self._turn_1pm) * arc_m)
        straight_m = distance_m - arc_m
        x_m, y_m = x_m + straight_m * math.cos(turned_rad), y_m + straight_m * math.sin(turned_rad)
        if abs(self.offset_m) <= GONE_M:
            self.station_m, self.offset_m, *_ = foot_point(self._road, x_m, y_m, self.station_m)
        return x_m, y_m, turned_rad


class Snapshot(NamedTuple):
    """All other vehicles at one instant: the fields of SimTruth, one item a vehicle."""

    x_m: tuple[float, ...] = ()
    y_m: tuple[float, ...] = ()
    yaw_rad: tuple[float, ...] = ()
    speed_mps: tuple[float, ...] = ()
    manoeuvres: tuple[str, ...] = ()


class Traffic:
    """All other vehicles of a run."""

    def __init__(
        self, vehicles: Sequence[TrafficVehicle], road: Road, *, nose_m: float, elapsed_s: float = 0.0
    ) -> None:
        """``nose_m``: station of the ego front bumper at t = 0; ``elapsed_s`` ≤ 0: the time now."""
        self._road, self._lines = road, SightLines(road)
        self.actors = [Actor(vehicle, road, nose_m=nose_m, elapsed_s=elapsed_s) for vehicle in vehicles]

    def step(self, elapsed_s: float, dt_s: float, *, nose_m: float) -> None:
        """Move every vehicle from ``elapsed_s`` by ``dt_s``."""
        for actor in self.actors:
            ends = actor.ends()
            actor.step(elapsed_s, dt_s, None if ends is None else self._gap_m(ends, nose_m))

    def snapshot(self) -> Snapshot:
        """Poses and speeds, and the kinds of phases that are under way."""
        if not self.actors:
            return Snapshot()
        x_m, y_m, yaw_rad = zip(*(actor.pose for actor in self.actors), strict=True)
        speeds_mps = tuple(actor.speed_mps for actor in self.actors)
        manoeuvres = tuple(kind for actor in self.actors for kind in actor.manoeuvres)
        return Snapshot(x_m, y_m, yaw_rad, speeds_mps, manoeuvres)

    def ahead(self, nose_m: float) -> tuple[Actor, float] | None:
        """The nearest vehicle in the ego lane with its middle before the ego bumper, and the gap to it [m]."""
        edge_m = self._road.width_at(nose_m) / 2 - INTO_LANE_M
        nearest: tuple[Actor, float] | None = None
        for actor in self.actors:
            ends = actor.ends()
            if ends is None:
                continue
            half_m = actor.body.width_m / 2
            low_m, high_m = min(o for _, o in ends) - half_m, max(o for _, o in ends) + half_m
            gap_m = self._gap_m(ends, nose_m)
            before = gap_m + abs(ends[1][0] - ends[0][0]) / 2 > 0.0
            if before and low_m < edge_m and high_m > -edge_m and (nearest is None or gap_m < nearest[1]):
                nearest = actor, gap_m
        return nearest

    def measured_lead(
        self, ego: Outline, *, nose_m: float, range_m: float, height_m: float, t_s: float
    ) -> LeadVehicle | None:
        """The nearest vehicle in the lane, as an exact range sensor on the front bumper measures it.

        Confidence 0 where there is none within ``range_m``, or where walls or crests hide its middle from the
        sensor, ``height_m`` above the road; None in a run without other vehicles, in which this sensor does not
        run. ``nose_m``: station of the ego front bumper.
        """
        if not self.actors:
            return None
        ahead = self.ahead(nose_m)
        if ahead is not None:
            box = ahead[0].box
            distance_m = min(ego.in_axes(*corner)[0] for corner in box.corners()) - ego.front_m
            eye = Spot(nose_m, *ego.at(ego.front_m), height_m)
            middle = Spot(ahead[0].station_m, *ahead[0].pose[:2], ahead[0].body.height_m / 2)
            if distance_m <= range_m and self._lines.are_free(eye, middle):
                ends = [ego.in_axes(*box.at(x_m)) for x_m in (box.rear_m, box.front_m)]
                return LeadVehicle(
                    t_s=t_s,
                    distance_m=distance_m,
                    lateral_m=min(ends)[1],  # of the middle of the nearer end
                    speed_mps=ahead[0].speed_mps * math.cos(box.yaw_rad - ego.yaw_rad),
                    confidence=1.0,
                )
        return LeadVehicle(t_s=t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)

    def _gap_m(self, ends: list[tuple[float, float]], nose_m: float) -> float:
        """From the ego bumper to the nearer end; on a closed road along the shorter way."""
        gap_m = min(station for station, _ in ends) - nose_m
        return math.remainder(gap_m, self._road.length_m) if self._road.closed else gap_m


def lane_centre_m(road: Road, lane: int, station_m: float) -> float:
    """Offset of the centre of a lane; where the road has no such lane, of one with the ego lane's width."""
    section = road.section_at(station_m)
    if section.lane_width_m_at_ends(lane, road.settings.lane_width_m) is None:
        return lane * road.width_at(station_m)
    return RoadLane(road, lane).centre_at(station_m)


def speed_and_distance(
    speed_mps: float, goal_mps: float, rate_mps2: float, dt_s: float
) -> tuple[float, float]:
    """Speed after ``dt_s`` on the way to ``goal_mps`` at a constant rate, and the distance driven [m]."""
    change_mps = goal_mps - speed_mps
    changing_s = min(dt_s, abs(change_mps) / rate_mps2)
    end_mps = (
        speed_mps + math.copysign(rate_mps2 * changing_s, change_mps) if changing_s == dt_s else goal_mps
    )
    return end_mps, (speed_mps + end_mps) / 2 * changing_s + end_mps * (dt_s - changing_s)


def least_jerk(share: float) -> tuple[float, float]:
    """10τ³ - 15τ⁴ + 6τ⁵ for τ in 0..1, and its slope."""
    t = min(max(share, 0.0), 1.0)
    return t**3 * (10 - 15 * t + 6 * t**2), 30 * t**2 * (1 - t) ** 2
