"""People, cyclists and animals: the speed at which the car can stop for them, and when it must brake hard.

Of each road user count its free way s ahead of the front bumper, its gap g beside the strip that the car drives
over (half its width, a margin, and the deviation of path and detector, which grows with the distance), and the
speed w of its approach. It is in the strip after t = g/w, where w is at least the speed u of a worst-case side
step: a standing person may walk, and a cyclist not riding along the lane may set off across it, at least as fast.
With the reaction time ρ,

    in the strip          v·ρ + v²/(2·a) ≤ s - s₀                             it stands s₀ before it, comfortably
    beside it             the same, or v ≤ 2·b·(t - ρ), or s ≤ v·t

The second alternative is v·ρ + v²/(2·b) ≤ v·t: wherever the car is when the road user steps out, it either stops
before it, or its front has passed before the road user is in the strip, which is the third one. Of one that already
walks towards the strip s reaches to the rear bumper there, because it would walk or ride into the side, and w is
larger by u, because it may still gain speed. b is the
comfortable deceleration where the road user already walks towards the strip, the strongest one where it stands at
the edge; a least speed beside those who stand keeps the car from waiting for a bystander.
RSS names these terms (Shalev-Shwartz, Shammah, Shashua, On a Formal Model of Safe and Scalable Self-driving Cars,
2017); Euro NCAP AEB VRU has the speeds of walkers.
"""

import math
from collections import deque
from typing import Annotated, NamedTuple

from pydantic import Field

from supervisor.inputs.road_users import RoadUser, WatchedUsers
from supervisor.path.fusion import Path
from trepid.bounds import at_least, at_most
from trepid.car.vehicle import Vehicle
from trepid.clothoid import STANDING, Lane, Motion
from trepid.config import Settings
from trepid.types import Positive, PositiveShare

CYCLIST, ANIMAL = "cyclist", "animal"
_CRAWL_MPS = 1.0  # least speed in a time: at standstill every distance would be enough


class KindSettings(Settings):
    """How a kind of road user may move."""

    step_mps: Positive  # u, the side step of one that stands
    margin_m: Positive  # beside the car


class GivingWaySettings(Settings):
    """Section ``giving_way`` of ``config/supervisor.yaml``."""

    min_confidence: PositiveShare
    decel_mps2: Positive  # a
    hard_decel_mps2: Positive  # a stop that needs more is an emergency stop
    strongest_decel_mps2: Annotated[float, Field(gt=0, le=4.0)]  # b, of an emergency stop
    reaction_s: Positive  # ρ
    brake_s: Positive  # until the brakes act
    gap_m: Positive  # s₀, from a standing car
    touch_m: Positive  # nearer is a collision
    margin_per_m: Positive  # growth of the margin with the distance
    back_m: Positive  # the car is back at the centre of its lane within this distance
    reach_m: Positive  # a lane is known to this distance
    moving_mps: Positive  # slower ones stand
    sure_s: Positive  # one that walks in within this time is in the strip, for a hard brake
    passing_mps: Positive  # beside one that stands, however near
    free_s: Positive  # the way is free for so long before the car goes on
    time_gap_s: Positive  # behind a cyclist
    cyclist_gap_m: Positive  # ... at standstill
    overtaking_m: Positive  # a cyclist with less room beside the car is followed, not overtaken
    person: KindSettings
    cyclist: KindSettings
    animal: KindSettings

    def of_kind(self, kind: str) -> KindSettings:
        """The settings of ``kind``; an unknown one counts as a person."""
        return {CYCLIST: self.cyclist, ANIMAL: self.animal}.get(kind, self.person)


class Way(NamedTuple):
    """The way that road users leave to the car."""

    cap_mps: float = math.inf  # the greatest speed; inf: no limit
    hard: bool = False  # a comfortable brake does not suffice
    time_s: float = math.inf  # to the nearest one in the strip, or on its way into it; inf: none
    kind: str = ""  # of the one that limits the speed; "": none
    ahead_m: float | None = None  # ... and its distance from the front bumper

    def sets(self, cap_mps: float) -> bool:
        """Whether it is what makes the car drive at most ``cap_mps``, or brake hard."""
        return self.hard or (self.cap_mps <= cap_mps and self.kind != "")


CLEAR = Way()


class Encounter(NamedTuple):
    """One road user relative to the strip that the car drives over."""

    kind: str
    free_m: float  # s, ahead of the front bumper; negative: beside the car
    gap_m: float  # g, beside the strip; at most 0: in it
    closing_mps: float  # of the gap, by its velocity
    along_mps: float  # speed along the lane, away from the car
    step_mps: float
    car_m: float  # length of the car

    @property
    def enters_s(self) -> float:
        """t: the least time until it may be in the strip [s]."""
        return at_least(self.gap_m, 0.0) / at_least(self.closing_mps, self.step_mps)


def encounter(user: RoadUser, lane: Lane, settings: GivingWaySettings, vehicle: Vehicle) -> Encounter:
    """``user`` relative to the strip along ``lane``, from the present place of the car to the centre of the lane.

    The car returns to the centre within ``back_m``; beyond ``reach_m`` the lane goes on along its tangent.
    """
    s, of_kind = settings, settings.of_kind(user.kind)
    ahead_m = at_least(user.x_m, 0.0)
    near_m = at_most(ahead_m, s.reach_m)
    slope = lane.slope_at(near_m)
    centre_m = lane.y_m(near_m) + slope * (ahead_m - near_m)
    aside_m = user.y_m - centre_m - lane.offset_m * at_least(1.0 - ahead_m / s.back_m, 0.0)
    x_mps, y_mps = user.x_mps or 0.0, user.y_mps or 0.0
    along_mps = x_mps + slope * y_mps
    rides_ahead = user.kind == CYCLIST and along_mps >= s.moving_mps
    sets_off = user.kind == CYCLIST and abs(along_mps) < s.moving_mps
    margin_m = s.overtaking_m if rides_ahead else of_kind.margin_m
    return Encounter(
        kind=user.kind,
        free_m=user.x_m - vehicle.wheelbase_m - vehicle.front_overhang_m,
        gap_m=abs(aside_m) - vehicle.track_m / 2 - margin_m - s.margin_per_m * ahead_m,
        closing_mps=-math.copysign(1.0, aside_m) * (y_mps - slope * x_mps),
        along_mps=along_mps,
        step_mps=at_least(s.person.step_mps, of_kind.step_mps) if sets_off else of_kind.step_mps,
        car_m=vehicle.rear_overhang_m + vehicle.wheelbase_m + vehicle.front_overhang_m,
    )


def stop_within(free_m: float, decel_mps2: float, reaction_s: float, *, approach_mps: float = 0.0) -> float:
    """The greatest v with v·ρ + v²/(2·a) + w·(ρ + v/a) ≤ s [m/s], w the speed of approach; 0 for s ≤ w·ρ."""
    room_m = free_m - approach_mps * reaction_s
    if not room_m > 0.0:
        return 0.0
    lag_mps = decel_mps2 * reaction_s + approach_mps
    # -lag + √(lag² + 2·a·s), without cancellation
    return 2 * decel_mps2 * room_m / (lag_mps + math.sqrt(lag_mps**2 + 2 * decel_mps2 * room_m))


def permitted_speed_mps(one: Encounter, speed_mps: float, settings: GivingWaySettings) -> float:
    """The greatest speed for ``one`` of a car that drives at ``speed_mps`` [m/s]."""
    s = settings
    approach_mps = at_least(-one.along_mps, 0.0)
    stop_mps = stop_within(one.free_m - s.gap_m, s.decel_mps2, s.reaction_s, approach_mps=approach_mps)
    if one.gap_m <= 0.0:
        if one.kind == CYCLIST and one.along_mps >= s.moving_mps:
            return _behind_cyclist_mps(one, s)
        return stop_mps
    walks = one.closing_mps >= s.moving_mps
    decel_mps2 = s.decel_mps2 if walks else s.strongest_decel_mps2
    pass_mps = 2 * decel_mps2 * at_least(one.enters_s - s.reaction_s, 0.0)
    if not walks or one.free_m <= 0.0:
        pass_mps = at_least(pass_mps, s.passing_mps)
    if passes_first(one, speed_mps, s):
        pass_mps = at_least(pass_mps, speed_mps)
    return at_least(pass_mps, stop_mps)


def passes_first(one: Encounter, speed_mps: float, s: GivingWaySettings) -> bool:
    """Whether the car passes ``one`` at this speed before it may be in the strip.

    The front counts before one that stands. Before one that walks towards the strip the whole car counts, and that
    one may become faster by the speed of a side step.
    """
    if one.free_m <= 0.0 or one.closing_mps < s.moving_mps:
        return one.gap_m > 0.0 and one.free_m < speed_mps * one.enters_s
    enters_s = one.gap_m / (one.closing_mps + one.step_mps)
    return one.gap_m > 0.0 and one.free_m + one.car_m < speed_mps * enters_s


def _behind_cyclist_mps(one: Encounter, s: GivingWaySettings) -> float:
    """min(s/T, √(w² + 2·a·s)), as behind a vehicle (:mod:`supervisor.path.follow`), with a larger gap."""
    free_m = at_least(one.free_m - s.cyclist_gap_m, 0.0)
    return at_most(free_m / s.time_gap_s, math.sqrt(one.along_mps**2 + 2 * s.decel_mps2 * free_m))


def needs_more(one: Encounter, speed_mps: float, decel_mps2: float, s: GivingWaySettings) -> bool:
    """Whether a brake with ``decel_mps2`` would end too near to ``one``, which is in the strip or walks into it."""
    enters = one.closing_mps >= s.moving_mps and one.enters_s <= s.sure_s
    if one.free_m <= 0.0 or not (one.gap_m <= 0.0 or (enters and not passes_first(one, speed_mps, s))):
        return False
    along_mps = at_least(one.along_mps, 0.0) if one.kind == CYCLIST else 0.0
    over = at_least(speed_mps**2 - along_mps**2, 0.0) / (2 * decel_mps2)
    return over > 0.0 and over + speed_mps * s.brake_s > one.free_m - s.touch_m


class GivingWay:
    """The speed cap for road users: it falls at once, and rises when the way has been free for ``free_s``."""

    def __init__(self, settings: GivingWaySettings, vehicle: Vehicle) -> None:
        self._settings, self._vehicle = settings, vehicle
        self._caps: deque[tuple[float, Way]] = deque()  # rising caps of the last free_s, with their times
        self._hard = False

    def step(self, watched: WatchedUsers, path: Path | None, motion: Motion | None, *, now_s: float) -> Way:
        """The way at ``now_s`` along ``path``; without one along the arc that the car drives.

        ``motion`` is the last known one. Where the road users are lost the last cap holds for ``free_s``; fear,
        which is 1 then, stops the car.
        """
        own = motion or STANDING
        speed_mps = abs(own.speed_mps)
        lane = Lane(0.0, 0.0, own.yaw_rate_radps / at_least(speed_mps, _CRAWL_MPS), 0.0)
        if path is not None:
            lane = path.lane.after(own, now_s - path.t_s)
        met = [
            encounter(user, lane, self._settings, self._vehicle)
            for user in watched.users or ()
            if user.x_m > 0.0 and user.confidence >= self._settings.min_confidence
        ]
        decel_mps2 = self._settings.decel_mps2 if self._hard else self._settings.hard_decel_mps2
        self._hard = any(needs_more(one, speed_mps, decel_mps2, self._settings) for one in met)
        return self._least(self._newest(met, speed_mps), now_s)

    def _newest(self, met: list[Encounter], speed_mps: float) -> Way:
        """The way by these road users alone."""
        s = self._settings
        if not met:
            return CLEAR
        caps = [permitted_speed_mps(one, speed_mps, s) for one in met]
        least = min(range(len(met)), key=caps.__getitem__)
        near = [
            at_least(one.free_m, 0.0) / at_least(speed_mps, _CRAWL_MPS)
            for one in met
            if one.gap_m <= 0.0 or (one.closing_mps >= s.moving_mps and one.enters_s <= s.sure_s)
        ]
        return Way(
            cap_mps=caps[least],
            hard=self._hard,
            time_s=min(near, default=math.inf),
            kind=met[least].kind,
            ahead_m=at_least(met[least].free_m, 0.0),
        )

    def _least(self, way: Way, now_s: float) -> Way:
        """``way``, with the least cap of the last ``free_s``."""
        while self._caps and self._caps[-1][1].cap_mps >= way.cap_mps:
            self._caps.pop()
        self._caps.append((now_s, way))
        while self._caps[0][0] < now_s - self._settings.free_s:
            self._caps.popleft()
        least = self._caps[0][1]
        return least._replace(hard=way.hard, time_s=way.time_s) if least is not way else way
