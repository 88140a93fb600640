"""The share of the cruise speed at a level of fear, which falls at once and rises slowly; the least of all caps."""

from typing import NamedTuple

from supervisor.path.follow import Follower
from supervisor.rules.inference import FearRules
from supervisor.situation.world_state import WorldState
from trepid.bounds import at_least, at_most
from trepid.clothoid import Motion
from trepid.messages import Limit


class Cap(NamedTuple):
    """A speed cap, and what sets it."""

    speed_mps: float
    limited_by: Limit
    factor: float  # the share of the cruise speed


def least_cap(
    world: WorldState,
    follower: Follower,
    factor: float,
    by: Limit,
    cruise_speed_mps: float,
    *,
    follows: bool,
) -> Cap:
    """The share ``factor`` of the cruise speed, set ``by`` a limit, at most what everything ahead permits.

    A car that ``follows`` the vehicle ahead drives at least at its pace. A driving network may propose a lower
    speed, never a higher one.
    """
    cruise_mps = cruise_speed_mps * factor
    if follows:
        pace_mps = at_most(follower.pace_mps(world.ahead), cruise_speed_mps)
        by = Limit.LEAD if pace_mps > cruise_mps else by
        cruise_mps = at_least(cruise_mps, pace_mps)
    caps = (
        (world.way.cap_mps, Limit.ROAD_USER),
        (cruise_mps, by),
        (follower.speed_cap_mps(world.ahead), Limit.LEAD),
        (world.sight.cap_mps, Limit.SIGHT),
        (world.proposal_mps, Limit.NETWORK),
    )
    speed_mps, limited_by = min(caps, key=lambda cap: cap[0])  # of equals the first
    return Cap(speed_mps, limited_by, factor)


class SpeedFactor:
    """The share of the cruise speed: falls with fear at once, rises slowly, but fast up to the present speed."""

    def __init__(self, cruise_speed_mps: float) -> None:
        self._cruise_speed_mps = cruise_speed_mps
        self._factor = 0.0
        self._last_s: float | None = None
        self.limited_by = Limit.RECOVERY
        """What sets the newest factor."""

    def step(
        self,
        rules: FearRules,
        fear: float,
        motion: Motion | None,
        *,
        stopping: bool,
        begins: bool,
        now_s: float,
    ) -> float:
        """The factor at ``now_s``; 0 while ``stopping``.

        A drive that ``begins`` starts with the present speed of the car: that of the driver, or standstill.
        """
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        if stopping:
            self._factor = 0.0
            return 0.0
        hysteresis = rules.file.hysteresis
        driven = 0.0 if motion is None else motion.speed_mps / self._cruise_speed_mps
        caught_up = driven if begins else at_most(self._factor + hysteresis.catch_up_per_s * dt_s, driven)
        risen = at_least(self._factor + hysteresis.recovery_per_s * dt_s, caught_up)
        allowed = rules.speed_factor(fear)
        self._factor = at_most(risen, allowed)
        by_fear = Limit.FEAR if allowed < 1.0 else Limit.CRUISE
        self.limited_by = Limit.RECOVERY if self._factor < allowed else by_fear
        return self._factor
