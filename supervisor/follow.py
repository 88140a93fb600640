"""The vehicle ahead: how fast one may drive behind it, and its trail as a path when the road is lost."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from supervisor.fusion import Path
from supervisor.lane import STANDING, Lane, Motion
from supervisor.sightings import SightingSettings, age_s, within
from trepid.config import Settings
from trepid.messages import LeadVehicle
from trepid.vehicle import Vehicle

Positive = Annotated[float, Field(gt=0)]


class FollowSettings(Settings):
    """Section ``follow`` of ``config/supervisor.yaml``."""

    min_confidence: Positive  # below, a lead is none to follow
    max_distance_m: Positive
    max_lateral_m: Positive  # farther to the side it drives on another road
    time_gap_s: Annotated[float, Field(ge=1.5)]
    standstill_gap_m: Positive
    decel_mps2: Positive  # comfortable braking behind a slower lead
    trail_spacing_m: Positive
    trail_length_m: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Lead:
    """The vehicle ahead, judged."""

    age_s: float = math.inf  # inf: never heard, or a stamp that cannot be
    confidence: float | None = None  # 0: no vehicle ahead, or no detector at all; None: broken or stale
    distance_m: float | None = None  # now; None: no vehicle ahead
    lateral_m: float = 0.0
    speed_mps: float = 0.0  # 0 when unknown: the worst to drive behind


def judge_lead(
    lead: LeadVehicle | None, motion: Motion | None, *, now_s: float, settings: SightingSettings
) -> Lead:
    """What ``lead`` is worth now. None means that no detector runs; "no vehicle" has confidence 0."""
    if lead is None:
        return Lead(confidence=0.0)
    age = age_s(lead.t_s, now_s=now_s, settings=settings)
    if age > settings.fresh_s or not 0 <= lead.confidence <= 1:
        return Lead(age_s=age)
    if lead.confidence == 0:
        return Lead(age_s=age, confidence=0.0)
    distance_m = within(lead.distance_m, settings.max_lead_distance_m)
    lateral_m = within(lead.lateral_m, settings.max_lead_distance_m)
    if distance_m is None or lateral_m is None:
        return Lead(age_s=age)
    speed_mps = max(0.0, within(lead.speed_mps, settings.max_speed_mps) or 0.0)
    closing_mps = max(0.0, (motion or STANDING).speed_mps - speed_mps)
    return Lead(
        age_s=age,
        confidence=lead.confidence,
        distance_m=max(0.0, distance_m - closing_mps * age),
        lateral_m=lateral_m,
        speed_mps=speed_mps,
    )


class Follower:
    """Remembers where the lead was, in the frame of the vehicle: its trail is a path that a car has driven."""

    def __init__(self, settings: FollowSettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._front_m = vehicle.wheelbase_m + vehicle.front_overhang_m  # front bumper before the rear axle
        self._trail: list[tuple[float, float]] = []  # (x, y) [m], oldest first
        self._t_s: float | None = None

    def usable(self, lead: Lead) -> bool:
        """Whether ``lead`` is sure, near and ahead enough to be followed."""
        return (
            lead.distance_m is not None
            and (lead.confidence or 0.0) >= self._settings.min_confidence
            and lead.distance_m <= self._settings.max_distance_m
            and abs(lead.lateral_m) <= self._settings.max_lateral_m
        )

    def step(self, lead: Lead, motion: Motion | None, *, now_s: float) -> Path | None:
        """The lead's path from here to its rear, None when there is none to follow."""
        self._move(motion or STANDING, now_s)
        if lead.distance_m is None or not self.usable(lead):
            self._trail = []
            return None
        here = (self._front_m + lead.distance_m, lead.lateral_m)
        if not self._trail or math.dist(here, self._trail[-1]) >= self._settings.trail_spacing_m:
            self._trail.append(here)
        return Path(now_s, _lane_through([*self._trail, here]), here[0], "lead")

    def speed_cap_mps(self, lead: Lead) -> float:
        """Greatest speed behind ``lead`` [m/s], inf without one.

        min((d - d0)/T, sqrt(v_lead² + 2·a·(d - d0))): holds the time gap T, and closes up on a slower lead no
        harder than with a.
        """
        if lead.distance_m is None:
            return math.inf
        free_m = max(0.0, lead.distance_m - self._settings.standstill_gap_m)
        braking_mps = math.sqrt(lead.speed_mps**2 + 2 * self._settings.decel_mps2 * free_m)
        return min(free_m / self._settings.time_gap_s, braking_mps)

    def _move(self, motion: Motion, now_s: float) -> None:
        """The trail as seen from where the vehicle is now; what lies behind the rear axle is forgotten."""
        dt_s = 0.0 if self._t_s is None else now_s - self._t_s
        self._t_s = now_s
        dx_m, dy_m, yaw_rad = motion.over(dt_s)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        moved = [
            ((x - dx_m) * cos + (y - dy_m) * sin, (y - dy_m) * cos - (x - dx_m) * sin) for x, y in self._trail
        ]
        self._trail = [point for point in moved if 0 <= point[0] <= self._settings.trail_length_m]


def _lane_through(trail: list[tuple[float, float]]) -> Lane:
    """The lane y(x) = a + b·x + c·x²/2 nearest to the trail (least squares).

    The way from the car to the oldest point is not known, so the car's own place and heading enter as one more
    point each: a single lead gives an arc to its rear, a long trail outweighs them.
    """
    points = np.array([(0.0, 0.0), *trail])
    x, y = points[:, 0], points[:, 1]
    scale_m = max(float(x[-1]), 1.0)
    u = x / scale_m
    rows = np.column_stack([np.ones_like(u), u, u**2 / 2])
    heading_row = [[0.0, 1.0, 0.0]]  # y'(0) = 0
    a, b, c = np.linalg.lstsq(np.vstack([rows, heading_row]), np.append(y, 0.0), rcond=None)[0]
    return Lane(float(-a), float(-b / scale_m), float(c / scale_m**2), 0.0)
