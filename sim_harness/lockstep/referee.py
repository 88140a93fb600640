"""Departures, interventions and collisions, judged on the true pose."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from sim_harness.world.plants.state import PlantState
from sim_harness.world.roads.road import FootPoint, Road
from trepid.car.vehicle import Vehicle

SEPARATED_M = 0.5  # a contact is over when the gap has grown to this


class Place(NamedTuple):
    """A pose relative to the road."""

    station_m: float  # continues over laps
    offset_m: float
    heading_error_rad: float


def foot_point(road: Road, x_m: float, y_m: float, near_station_m: float) -> FootPoint:
    """The foot of a point on ``road``; the station continues from ``near_station_m`` over laps."""
    foot = road.foot_point(x_m, y_m, near_station_m=near_station_m)
    if not road.closed:
        return foot
    ahead_m = math.remainder(foot.station_m - near_station_m, road.length_m)
    return foot._replace(station_m=near_station_m + ahead_m)


def locate(road: Road, pose: PlantState, near_station_m: float) -> Place:
    """The place of the rear axle on ``road``; the station continues from ``near_station_m``."""
    foot = foot_point(road, pose.x_m, pose.y_m, near_station_m)
    return Place(foot.station_m, foot.offset_m, math.remainder(pose.yaw_rad - foot.heading_rad, math.tau))


def wheel_outside(road: Road, vehicle: Vehicle, pose: PlantState, place: Place) -> bool:
    """True when the outer edge of a wheel is over the edge of the lane.

    The wheels stand ``track_m / 2`` beside the axle centres, square to the vehicle.
    """
    half_m = vehicle.track_m / 2 * math.cos(place.heading_error_rad)
    outside_m = abs(place.offset_m) + half_m
    if outside_m > road.width_at(place.station_m) / 2:
        return True
    turn = vehicle.wheelbase_m * road.max_curvature_1pm
    swing_m = vehicle.wheelbase_m * (abs(math.sin(place.heading_error_rad)) + turn)
    if turn < 0.5 and outside_m + swing_m < road.min_width_m / 2:
        return False  # an upper bound on the offset of the front wheels
    front_x_m = pose.x_m + vehicle.wheelbase_m * math.cos(pose.yaw_rad)
    front_y_m = pose.y_m + vehicle.wheelbase_m * math.sin(pose.yaw_rad)
    near_m = place.station_m + vehicle.wheelbase_m
    front_station_m, front_offset_m = road.local_coordinates(front_x_m, front_y_m, near_station_m=near_m)
    return abs(front_offset_m) + half_m > road.width_at(front_station_m) / 2


class Referee:
    """Counts departures, interventions and collisions of one run.

    A departure is a wheel over the lane edge; an intervention follows it, or an offset beyond ``max_offset_m``.
    The car is re-centred at once, so that every excursion counts once.
    """

    def __init__(self, road: Road, vehicle: Vehicle, *, max_offset_m: float) -> None:
        self._road = road
        self._vehicle = vehicle
        self._max_offset_m = max_offset_m
        self._touched: set[int] = set()
        self.departures = 0
        self.interventions = 0
        self.collisions = 0

    def must_recentre(self, pose: PlantState, place: Place) -> bool:
        """Judge the pose; True when the car must be re-centred on the lane."""
        departed = wheel_outside(self._road, self._vehicle, pose, place)
        self.departures += departed
        if departed or abs(place.offset_m) > self._max_offset_m:
            self.interventions += 1
            return True
        return False

    def judge_contacts(self, separations_m: Sequence[float]) -> None:
        """Count new contacts; ``separations_m``: one item per vehicle, ≤ 0 while it is in contact."""
        for number, separation in enumerate(separations_m):
            if separation <= 0.0:
                self.collisions += number not in self._touched
                self._touched.add(number)
            elif separation > SEPARATED_M:
                self._touched.discard(number)
