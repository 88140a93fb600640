"""A warning to the driver before a wheel leaves the lane, also in manual driving: section ``line_warning``.

The time to line crossing of an axle is the first t with

    u·t + a·t²/2 = d        u = v·ψ + x·(ω - κ·v)        a = v·(ω - κ·v)

where d is the distance of the outer wheel from the edge, x the place of the axle ahead of the rear one, ψ the
heading error, ω the yaw rate and κ the curvature of the lane (Mammar et al., Time to line crossing for lane
departure avoidance, IEEE Trans. ITS 7, 2006); of both axles the least. A warning begins when it falls below
``ahead_s``, but not before the earliest warning line of ISO 17361:2017, which depends on the speed of
approach u of the front wheel:

    d ≤ 1.5 s · min(max(u, 0.5 m/s), 1 m/s)        0.75 m to 1.5 m

so that driving parallel to the edge of a lane gives no warning. The standard demands a warning 0.3 m beyond the
edge at the latest; here a wheel beyond it that does not come back counts as a crossing.
"""

import math
from typing import NamedTuple

from supervisor.inputs.timers import Stopwatch
from supervisor.situation.features import BEYOND, first_root, narrowest_m
from supervisor.situation.world_state import WorldState
from trepid.bounds import at_least, at_most
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, Motion
from trepid.config import Settings
from trepid.types import NonNegative, Positive

EARLIEST_S = 1.5  # ISO 17361:2017: of the earliest warning line, for speeds of approach ...
LEAST_APPROACH_MPS, MOST_APPROACH_MPS = 0.5, 1.0  # ... between these
SIDES = {"left": 1.0, "right": -1.0}


class LineWarningSettings(Settings):
    """Section ``line_warning`` of ``config/supervisor.yaml``."""

    enabled: bool
    from_mps: Positive  # slower cars are not warned
    ahead_s: Positive
    confirm_s: NonNegative
    hold_s: NonNegative


class Approach(NamedTuple):
    """How the wheels of one side come to the edge of the lane."""

    time_s: float  # until the first is over it; 0 beyond it, BEYOND: none comes
    room_m: float  # of the nearest wheel; negative beyond the edge
    speed_mps: float  # of the front wheel towards the edge


def approach(
    lane: Lane, width_m: float, motion: Motion, *, side: float, half_width_m: float, wheelbase_m: float
) -> Approach:
    """The approach to the edge on ``side``, +1 left and -1 right, of a lane that is ``width_m`` wide."""
    turn_radps = motion.yaw_rate_radps - lane.curvature_1pm * motion.speed_mps
    found: list[tuple[float, float, float]] = []
    for axle_m in (0.0, wheelbase_m):
        room_m = width_m / 2 - half_width_m + side * lane.y_m(axle_m)
        speed_mps = side * (motion.speed_mps * lane.heading_rad + axle_m * turn_radps)
        if room_m > 0.0:
            time_s = first_root(room_m, speed_mps, side * motion.speed_mps * turn_radps)
        else:
            time_s = 0.0 if speed_mps >= 0.0 else BEYOND  # beyond the edge, and on the way back
        found.append((time_s, room_m, speed_mps))
    times_s, rooms_m, _ = zip(*found, strict=True)
    return Approach(min(times_s), min(rooms_m), found[1][2])


def is_due(seen: Approach, ahead_s: float) -> bool:
    """Whether a driver is to be warned of ``seen``: late enough by time, and within the earliest warning line."""
    earliest_m = EARLIEST_S * at_most(at_least(seen.speed_mps, LEAST_APPROACH_MPS), MOST_APPROACH_MPS)
    return seen.time_s < ahead_s and seen.room_m <= earliest_m


class LineSign(NamedTuple):
    """The fields of a decision about the edges of the lane."""

    line_warning: str = ""  # the side of the warning; "": none
    line_crossing_s: float | None = (
        None  # until a wheel is over an edge; None: not known, or none comes to it
    )


class LineWarning:
    """Warns when the approach has been due for ``confirm_s``, and for ``hold_s`` after it was last due.

    Nothing is said where lane, width or motion are not known: fear rates that.
    """

    def __init__(self, settings: LineWarningSettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._car = {"half_width_m": vehicle.track_m / 2, "wheelbase_m": vehicle.wheelbase_m}
        self._due = {side: Stopwatch() for side in SIDES}
        self._side, self._until_s = "", -math.inf

    def step(self, world: WorldState, *, now_s: float) -> LineSign:
        """The sign at ``now_s``, by the fused lane, its measured width, and the motion."""
        path, width_m, motion = world.fused.path, narrowest_m(world.estimates), world.motion
        seen: dict[str, Approach] = {}
        if path and path.measured and world.fused.sources and motion and width_m < BEYOND:
            seen = {
                name: approach(path.lane, width_m, motion, side=side, **self._car)
                for name, side in SIDES.items()
            }
        limits = self._settings
        warns = limits.enabled and motion is not None and motion.speed_mps >= limits.from_mps
        for name, watch in self._due.items():
            due = warns and name in seen and is_due(seen[name], limits.ahead_s)
            if watch.step(due, now_s=now_s) >= limits.confirm_s and due:
                self._side, self._until_s = name, now_s + limits.hold_s
        if not seen:
            self._until_s = -math.inf
            return LineSign()
        least_s = min(one.time_s for one in seen.values())
        return LineSign(self._side if now_s <= self._until_s else "", least_s if least_s < BEYOND else None)
