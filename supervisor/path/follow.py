"""The vehicle ahead: the speed limit behind it, and its trail as a path where the road is lost."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

from pydantic import Field

from supervisor.inputs.timers import HoldTimer
from supervisor.inputs.validation import ValidationSettings, within
from supervisor.path.fusion import Path
from supervisor.path.sight_speed import StoppingWay
from supervisor.path.trail import LEAD, Trail, TrailSettings, fit, max_curvature_rate_1pm2
from trepid.car.vehicle import Vehicle
from trepid.clothoid import STANDING, Lane, Motion
from trepid.config import Settings
from trepid.messages import LeadVehicle
from trepid.types import NonNegative, Positive

STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)
LED_BACK_S = 2.0  # the trail is driven for a while after the road is back (modes.road_back_s)
SAME_LEAD_M, AT_ONCE_S = 1.0, 0.15  # from one detection to the next; beyond, it is another vehicle
ASTRAY_S = (
    0.2  # a leader off the trail for this long has left the road; shorter errors are those of the detector
)


class FollowSettings(Settings):
    """Section ``follow`` of ``config/supervisor.yaml``."""

    min_confidence: Positive  # least confidence of a lead to follow
    max_distance_m: Positive
    max_lateral_m: Positive  # farther to the side it is on another road
    time_gap_s: Annotated[float, Field(ge=1.5)]
    standstill_gap_m: Positive
    standstill_slack_m: NonNegative  # nearer than this to the gap the car stands instead of creeping on
    decel_mps2: Positive  # comfortable braking behind a slower lead, and of a comfort stop
    touch_m: Positive  # nearer than that is a collision
    hold_s: Positive  # a lead that is no longer detected is assumed to be there for this long
    max_follow_s: Positive  # greatest time of following without a measured road
    least_ahead_m: Positive  # of trail, to drive on it
    lag_s: Positive  # the trail older than this predicts the position of a lead on the road
    least_lag_m: Positive  # ... and at least this far behind it
    reference_m: Positive  # length of the older trail that is used
    gate_sigmas: Positive  # a lead farther from the prediction has left the road, or is another vehicle
    max_gate_m: Positive  # upper limit of this distance
    gate_road_m: Positive  # greatest distance from the lane centre, where that is measured
    hand_over_s: Positive
    trail: TrailSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Lead:
    """The vehicle ahead after validation."""

    age_s: float = math.inf  # inf: no message yet, or an invalid stamp
    confidence: float | None = None  # 0: no vehicle ahead, or no detector at all; None: broken or stale
    distance_m: float | None = None  # now; None: no vehicle ahead
    lateral_m: float = 0.0
    speed_mps: float = 0.0  # 0 when unknown, the worst case


NO_LEAD = Lead(confidence=0.0)


def judge_lead(
    lead: LeadVehicle | None,
    motion: Motion | None,
    *,
    now_s: float,
    settings: ValidationSettings,
    malformed: bool = False,
) -> Lead:
    """The vehicle ahead at ``now_s``. None means that no detector runs; "no vehicle" has confidence 0.

    ``malformed``: the newest message could not be decoded, so ``lead`` is older and only its age counts.
    """
    age = settings.age_s(lead, now_s=now_s)
    if lead is None and not malformed:
        return NO_LEAD
    if lead is None or malformed or age > settings.fresh_s or not 0 <= lead.confidence <= 1:
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


class Following(NamedTuple):
    """Whether the leader can be followed, and its trail."""

    usable: bool  # the leader can be followed
    path: Path | None  # along its trail, also to stop only; None long after the road is measured again


NO_LEADER = Following(usable=False, path=None)


class Follower:
    """Follows the trail of the vehicle ahead, as long as the trail can be a road.

    The position of the leader is added to the trail only near the lane centre while the lane is measured, else near
    the clothoid through the older part of the trail. A leader elsewhere is not followed: it turns off, leaves the
    road, or drives on another road. A vehicle that takes its place on the trail is followed.
    """

    def __init__(self, settings: FollowSettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._front_m = vehicle.wheelbase_m + vehicle.front_overhang_m  # front bumper before the rear axle
        self._trail = Trail(settings.trail)
        self._road: Lane | None = None  # last measured or driven lane, in the present vehicle frame
        self._road_s = -math.inf  # time of its last measurement
        self._held = NO_LEAD  # the last detected lead, moved with the vehicles
        self._now_s: float | None = None
        self._seen_s = -math.inf  # last time of a lead on the trail
        self._speed_mps = 0.0  # the greater of the speeds of vehicle and lead
        self._led_s = -math.inf  # last time without a measured road
        self._lead_m = math.inf  # last distance of the leader, on or off the trail
        self._lead_s = -math.inf  # time of this distance
        self._astray = HoldTimer()  # the leader is off the trail
        self._left = False  # the leader has left the road
        self._points = self._trail.visible_points()
        self._ahead_m = -math.inf  # end of the trail ahead

    def usable(self, lead: Lead) -> bool:
        """Whether the confidence and the position of ``lead`` are within the limits for following."""
        return (
            lead.distance_m is not None
            and (lead.confidence or 0.0) >= self._settings.min_confidence
            and lead.distance_m <= self._settings.max_distance_m
            and abs(lead.lateral_m) <= self._settings.max_lateral_m
        )

    def step(self, lead: Lead, road: Path | None, motion: Motion | None, *, now_s: float) -> Following:
        """Update the trail with ``lead``, and with the ``road`` where it is measured."""
        own = motion or STANDING
        dt_s = 0.0 if self._now_s is None else now_s - self._now_s
        self._now_s = now_s
        self._trail.move(own, dt_s)
        self._held = _move_lead(self._held, lead, own, dt_s, hold_s=self._settings.hold_s)
        self._speed_mps = max(abs(own.speed_mps), lead.speed_mps)
        if road is not None:
            self._road, self._road_s = road.lane.after(own, now_s - road.t_s), now_s
        elif self._road is not None:
            self._road = self._road.after(own, dt_s)
        self._points = self._trail.visible_points()
        self._take(lead, seen=road is not None, now_s=now_s)
        self._ahead_m = float(self._points[:, 0].max(initial=-math.inf))
        if self._ahead_m < self._settings.least_ahead_m:
            return NO_LEADER
        lately = now_s - self._seen_s <= self._settings.hold_s
        in_time = now_s - self._road_s <= self._settings.max_follow_s
        if road is None:
            self._led_s = now_s
        led = now_s - self._led_s <= LED_BACK_S
        return Following(lately and in_time, self._path(now_s) if led else None)

    def _take(self, lead: Lead, *, seen: bool, now_s: float) -> None:
        """Add the position of the lead to the trail if it is within the gate."""
        if lead.distance_m is None or not self.usable(lead):
            return
        ahead_m = self._front_m + lead.distance_m
        where = self._lane_gate(ahead_m) if seen else self._trail_gate(ahead_m)
        ours = abs(ahead_m - self._lead_m) < SAME_LEAD_M and now_s - self._lead_s < AT_ONCE_S
        gone = self._left and ours and not seen
        astray = gone or abs(lead.lateral_m - where.y_m) > where.within_m
        if not astray:
            self._trail.add(ahead_m, lead.lateral_m)
            self._seen_s, self._left = now_s, False
        if ours or not astray:  # another vehicle enters from the side and is not followed yet
            self._lead_m, self._lead_s = ahead_m, now_s
        if self._astray.lasts(ours and astray, ASTRAY_S, now_s=now_s) and not self._left:
            self._trail.forget_beyond(ahead_m - self._lag_m)
            self._left = True
        self._points = self._trail.visible_points()

    @property
    def _lag_m(self) -> float:
        """Length of the newest part of the trail, which is compared with the older part."""
        return max(self._settings.lag_s * self._speed_mps, self._settings.least_lag_m)

    def _lane_gate(self, ahead_m: float) -> "Gate":
        """The lane centre; the gate widens beyond ``window_m`` by the possible bend of a road."""
        assert self._road is not None
        far_m = max(ahead_m - self._settings.trail.window_m, 0.0)
        return Gate(self._road.y_m(ahead_m), self._settings.gate_road_m + self._bend_m(far_m))

    def _trail_gate(self, ahead_m: float) -> "Gate":
        """The extrapolated older part of the trail; the gate widens beyond it by the possible bend of a road."""
        s, x_m = self._settings, self._points[:, 0]
        known = self._points[x_m <= x_m.max(initial=0.0) - self._lag_m]
        end_m = float(known[:, 0].max(initial=0.0))
        reference = fit(
            known, self._prior, s.trail, around_m=end_m, window_m=s.reference_m, speed_mps=self._speed_mps
        )
        sighting_m = s.trail.sigma_m + s.trail.sigma_per_m * ahead_m
        sigma_m = math.hypot(reference.sigma_m(ahead_m), sighting_m)
        within_m = s.gate_sigmas * sigma_m + self._bend_m(max(ahead_m - end_m, 0.0))
        return Gate(reference.lane.y_m(ahead_m), min(within_m, s.max_gate_m))

    def _bend_m(self, over_m: float) -> float:
        """Lateral deviation of a road over ``over_m`` at the largest curvature rate [m]: κ'·s³/6."""
        return max_curvature_rate_1pm2(self._speed_mps, self._settings.trail) * over_m**3 / 6

    @property
    def _prior(self) -> Lane:
        """The path without the trail: the last measured road, else straight ahead."""
        return STRAIGHT if self._road is None else self._road._replace(curvature_rate_1pm2=0.0)

    def _path(self, now_s: float) -> Path:
        """The path along the trail; without a measured road it is also the prior of the next one."""
        s = self._settings.trail
        lane = fit(
            self._points, self._prior, s, around_m=0.0, window_m=s.window_m, speed_mps=self._speed_mps
        ).lane
        if now_s > self._road_s:
            self._road = lane
        return Path(now_s, lane, self._ahead_m, LEAD)

    def pace_mps(self, lead: Lead) -> float:
        """The speed below which fear does not slow a car that follows ``lead`` [m/s]; 0 without a trail.

        A car that falls behind loses the only measurement of the road. So it is the speed of the leader, but at
        most sqrt(2·a·s), from which a comfort stop ends at the end of the known trail, s ahead.
        """
        if self._ahead_m < self._settings.least_ahead_m or not self.usable(lead):
            return 0.0
        return min(lead.speed_mps, math.sqrt(2 * self._settings.decel_mps2 * self._ahead_m))

    def speed_cap_mps(self, lead: Lead) -> float:
        """Greatest speed behind ``lead`` [m/s], inf without a lead for ``hold_s``.

        min((d - d0)/T, sqrt(v_lead² + 2·a·(d - d0))): keeps the time gap T and brakes behind a slower lead with at
        most a. 0 where d - d0 is within the slack: (d - d0)/T alone would be crept for several T.
        """
        ahead = self._held if lead.distance_m is None else lead
        if ahead.distance_m is None:
            return math.inf
        free_m = ahead.distance_m - self._settings.standstill_gap_m
        if free_m <= self._settings.standstill_slack_m:
            return 0.0
        braking_mps = math.sqrt(ahead.speed_mps**2 + 2 * self._settings.decel_mps2 * free_m)
        return min(free_m / self._settings.time_gap_s, braking_mps)

    def is_closing_in(self, lead: Lead, motion: Motion | None, stop: StoppingWay) -> bool:
        """Whether ``stop``, relative to a ``lead`` that keeps its speed, ends nearer to it than ``touch_m``."""
        ahead = self._held if lead.distance_m is None else lead
        sure = (ahead.confidence or 0.0) >= self._settings.min_confidence
        if ahead.distance_m is None or motion is None or not sure:
            return False
        return stop.way_m(motion.speed_mps - ahead.speed_mps) > ahead.distance_m - self._settings.touch_m

    def ahead_m(self, lead: Lead) -> float:
        """Distance of the nearer end of the vehicle ahead from the rear axle [m]; inf without one."""
        ahead = self._held if lead.distance_m is None else lead
        return math.inf if ahead.distance_m is None else self._front_m + ahead.distance_m

    def is_near(self, lead: Lead, motion: Motion | None) -> bool:
        """Whether a comfort stop would end too near to ``lead`` if it brakes with the same deceleration.

        Two vehicles with equal deceleration approach each other by (v² - v_lead²)/(2·a).
        """
        ahead = self._held if lead.distance_m is None else lead
        sure = (ahead.confidence or 0.0) >= self._settings.min_confidence
        if ahead.distance_m is None or motion is None or not sure:
            return False
        nearer_m = (motion.speed_mps**2 - ahead.speed_mps**2) / (2 * self._settings.decel_mps2)
        return nearer_m > max(0.0, ahead.distance_m - self._settings.touch_m)


class Gate(NamedTuple):
    """The lateral range of a leader on the road."""

    y_m: float
    within_m: float


def _move_lead(held: Lead, lead: Lead, own: Motion, dt_s: float, *, hold_s: float) -> Lead:
    """The lead; without a lead the last one for ``hold_s``, moved at its last speed."""
    if lead.distance_m is not None:
        return replace(lead, age_s=0.0)
    if held.distance_m is None or held.age_s + dt_s > hold_s:
        return NO_LEAD
    nearer_m = max(own.speed_mps - held.speed_mps, 0.0) * dt_s
    return replace(held, age_s=held.age_s + dt_s, distance_m=max(held.distance_m - nearer_m, 0.0))
