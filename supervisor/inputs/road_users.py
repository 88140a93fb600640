"""The people, cyclists and animals ahead after validation, at the time of a decision."""

import math
from typing import NamedTuple

from supervisor.inputs.validation import ValidationSettings, within
from trepid.clothoid import STANDING, Motion
from trepid.messages import RoadUsers


class RoadUser(NamedTuple):
    """One of them: its ground point in the frame of the rear axle, and its velocity over ground."""

    kind: str
    x_m: float
    y_m: float
    x_mps: float | None  # None: not known, for both axes
    y_mps: float | None
    confidence: float


class WatchedUsers(NamedTuple):
    """The road users at one step."""

    age_s: float = math.inf  # inf: no message yet, or an invalid stamp
    users: tuple[RoadUser, ...] | None = None  # None: broken or stale
    detects: tuple[str, ...] = ()  # the kinds that the detector finds; the car is blind to the others


NO_DETECTOR = WatchedUsers(users=())
"""Nothing looks for people: there may be some."""


def judge_road_users(
    message: RoadUsers | None,
    motion: Motion | None,
    *,
    now_s: float,
    settings: ValidationSettings,
    malformed: bool = False,
) -> WatchedUsers:
    """The road users at ``now_s``. A ``message`` of None means that no detector runs.

    One item that is not possible makes the message broken: a person would be missing. ``malformed``: the newest
    message could not be decoded, so ``message`` is older and only its age counts. A road user moves on at its
    velocity for the age of the message, the car at ``motion``, which is None when lost: it then counts as standing.
    """
    age_s = settings.age_s(message, now_s=now_s)
    if message is None and not malformed:
        return NO_DETECTOR
    if message is None or malformed or age_s > settings.fresh_s:
        return WatchedUsers(age_s)
    columns = (message.x_m, message.y_m, message.x_mps, message.y_mps, message.confidences)
    if any(len(column) != len(message.kinds) for column in columns):
        return WatchedUsers(age_s)
    moved = (motion or STANDING).over(age_s)
    users = []
    for kind, *numbers in zip(message.kinds, *columns, strict=True):
        x_m, y_m, x_mps, y_mps, confidence = numbers
        user = RoadUser(kind, x_m, y_m, _speed_or_none(x_mps), _speed_or_none(y_mps), confidence)
        if not _is_possible(user, settings):
            return WatchedUsers(age_s)
        users.append(_move_user(user, moved, age_s))
    return WatchedUsers(age_s, tuple(users), message.detects)


def _speed_or_none(speed_mps: float) -> float | None:
    return None if math.isnan(speed_mps) else speed_mps


def _is_possible(user: RoadUser, settings: ValidationSettings) -> bool:
    """Whether the place, the confidence and the velocity, where there is one, are within the limits."""
    places = (within(user.x_m, settings.max_lead_distance_m), within(user.y_m, settings.max_lead_distance_m))
    speeds = [speed for speed in (user.x_mps, user.y_mps) if speed is not None]
    possible = all(within(speed, settings.max_speed_mps) is not None for speed in speeds)
    return None not in places and possible and len(speeds) != 1 and 0 <= user.confidence <= 1


def _move_user(user: RoadUser, moved: tuple[float, float, float], dt_s: float) -> RoadUser:
    """``user`` after ``dt_s``, in the frame of the vehicle that has ``moved`` (x, y, yaw) meanwhile."""
    x_mps, y_mps = user.x_mps or 0.0, user.y_mps or 0.0
    ahead_m, left_m, yaw_rad = moved
    x_m, y_m = _rotate(user.x_m + x_mps * dt_s - ahead_m, user.y_m + y_mps * dt_s - left_m, -yaw_rad)
    if user.x_mps is None:
        return user._replace(x_m=x_m, y_m=y_m)
    x_mps, y_mps = _rotate(x_mps, y_mps, -yaw_rad)
    return user._replace(x_m=x_m, y_m=y_m, x_mps=x_mps, y_mps=y_mps)


def _rotate(x: float, y: float, by_rad: float) -> tuple[float, float]:
    cos, sin = math.cos(by_rad), math.sin(by_rad)
    return cos * x - sin * y, sin * x + cos * y
