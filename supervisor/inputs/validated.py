"""What the messages are worth: every age, and every number that cannot be, is judged here and nowhere else."""

import math
from typing import NamedTuple

from trepid.bounds import at_least
from trepid.clothoid import Lane, Motion
from trepid.config import Settings
from trepid.messages import ImageStatistics, SteeringEstimate, VehicleState
from trepid.types import Positive


class SightingSettings(Settings):
    """Section ``sightings`` of ``config/supervisor.yaml``."""

    clock_tolerance_s: Positive  # stamps may lie this far in the future
    fresh_s: Positive  # older estimates, statistics and leads are not used
    state_fresh_s: Positive  # older vehicle states are not used
    frozen_s: Positive  # a picture that has repeated itself for longer while the car moves shows no lane
    frozen_speed_mps: Positive  # ... from this speed on
    lost_s: Positive  # a process that was heard and has been silent this long is lost
    min_confidence: Positive  # estimates below are no estimates
    max_offset_m: Positive  # beyond these a number cannot be: the message is broken
    max_heading_rad: Positive
    max_curvature_1pm: Positive
    max_curvature_rate_1pm2: Positive
    max_speed_mps: Positive
    max_lead_distance_m: Positive
    max_yaw_rate_radps: Positive
    min_lane_width_m: Positive
    max_lane_width_m: Positive
    max_unmarked_width_m: Positive  # edges farther apart without lines are those of two lanes: which is ours?


class Sighting(NamedTuple):
    """One estimator's lane, judged."""

    estimator: str
    age_s: float  # inf: never heard, or a stamp that cannot be
    t_s: float  # NaN: none
    broken: bool  # the message contradicts itself: confidence without a finite lane, or no number at all
    confidence: float | None  # None: broken or lost
    lane: Lane | None  # at t_s; None: not to be used
    lookahead_m: float
    width_error_m: float | None  # beyond what lanes measure; None: unknown
    measures_width: bool  # whether it claims to see a boundary, or remembers to have seen one
    width_m: float | None = None  # of the lane; None: unknown, or impossible
    marked: bool | None = None  # seen by painted lines; False: by the edges of the road
    from_memory: bool = False  # the estimator looks for boundaries and found none in this frame: it remembers


def age_s(t_s: float | None, *, now_s: float, settings: SightingSettings) -> float:
    """Age of a stamp [s]; inf where there is none, none that is finite, or one from the future."""
    if t_s is None or not math.isfinite(t_s) or t_s > now_s + settings.clock_tolerance_s:
        return math.inf
    return at_least(now_s - t_s, 0.0)


def sight(
    name: str,
    estimate: SteeringEstimate | None,
    *,
    now_s: float,
    settings: SightingSettings,
    frozen: bool = False,
) -> Sighting:
    """What ``estimate`` of the estimator ``name`` is worth now. An honest "no lane" has confidence 0.

    ``frozen``: the picture stands still while the car moves, so a lane in it is one of the past.
    """
    age = age_s(estimate.t_s if estimate else None, now_s=now_s, settings=settings)
    if estimate is None or age > settings.lost_s:
        t_s = estimate.t_s if estimate and math.isfinite(age) else math.nan
        return Sighting(name, age, t_s, False, None, None, math.nan, None, False)
    lane = lane_of(estimate, settings)
    broken = not 0 <= estimate.confidence <= 1 or (estimate.confidence > 0 and lane is None)
    two_lanes = _is_of_two_lanes(estimate, settings)
    usable = (
        not (broken or frozen or two_lanes)
        and age <= settings.fresh_s
        and estimate.confidence >= settings.min_confidence
    )
    from_memory = estimate.marked is not None and estimate.lanes_detected == 0
    return Sighting(
        estimator=name,
        age_s=age,
        t_s=estimate.t_s,
        broken=broken,
        confidence=None if broken else 0.0 if two_lanes else estimate.confidence,
        lane=lane if usable else None,
        lookahead_m=estimate.lookahead_m,
        width_error_m=_width_error_m(estimate.lane_width_m, settings),
        measures_width=usable and (estimate.lanes_detected > 0 or from_memory),  # who remembers has measured
        width_m=within(estimate.lane_width_m, settings.max_offset_m) if usable else None,
        marked=estimate.marked if usable else None,
        from_memory=from_memory,
    )


def surest_teller(seen: list[Sighting]) -> Sighting | None:
    """The surest of those that can tell a road with lines from one with edges only."""
    tellers = [s for s in seen if s.marked is not None]
    return max(tellers, key=lambda s: s.confidence or 0.0, default=None)


def lane_of(estimate: SteeringEstimate, settings: SightingSettings) -> Lane | None:
    """The lane at the rear axle; None unless every number is there, finite and possible."""
    offset_m = within(estimate.lateral_offset_m, settings.max_offset_m)
    heading_rad = within(estimate.heading_error_rad, settings.max_heading_rad)
    curvature_1pm = within(estimate.curvature_1pm, settings.max_curvature_1pm)
    rate_1pm2 = within(estimate.curvature_rate_1pm2, settings.max_curvature_rate_1pm2)
    if offset_m is None or heading_rad is None or curvature_1pm is None or rate_1pm2 is None:
        return None
    if not 0 <= estimate.lookahead_m < math.inf:
        return None
    lane = Lane.from_ahead(
        offset_m=offset_m,
        heading_rad=heading_rad,
        ahead_1pm=curvature_1pm,
        curvature_rate_1pm2=rate_1pm2,
        lookahead_m=estimate.lookahead_m,
    )
    return None if within(lane.curvature_1pm, settings.max_curvature_1pm) is None else lane


def is_frozen(
    statistics: ImageStatistics | None, motion: Motion | None, *, settings: SightingSettings
) -> bool:
    """Whether the picture repeats itself while the car moves, or may do so: sensor noise never repeats."""
    if statistics is None or statistics.frozen_s <= settings.frozen_s:
        return False
    return motion is None or not abs(motion.speed_mps) < settings.frozen_speed_mps


def motion_of(state: VehicleState | None, *, now_s: float, settings: SightingSettings) -> Motion | None:
    """How the vehicle moves; None when its state is missing, stale, or holds a number that cannot be."""
    if state is None or age_s(state.t_s, now_s=now_s, settings=settings) > settings.state_fresh_s:
        return None
    speed_mps = within(state.speed_mps, settings.max_speed_mps)
    yaw_rate_radps = within(state.yaw_rate_radps, settings.max_yaw_rate_radps)
    wheel_rad = within(state.road_wheel_angle_rad, math.pi / 2)
    if speed_mps is None or yaw_rate_radps is None or wheel_rad is None:
        return None
    return Motion(speed_mps, yaw_rate_radps)


def _is_of_two_lanes(estimate: SteeringEstimate, settings: SightingSettings) -> bool:
    """Whether only the edges of a road of more than one lane are seen; a width that cannot be may be one."""
    width_m = estimate.lane_width_m
    return (
        estimate.marked is False and width_m is not None and not 0 < width_m <= settings.max_unmarked_width_m
    )


def _width_error_m(width_m: float | None, settings: SightingSettings) -> float | None:
    if width_m is None or not math.isfinite(width_m):
        return None
    beyond_m = at_least(settings.min_lane_width_m - width_m, width_m - settings.max_lane_width_m)
    return at_least(beyond_m, 0.0)


def within(value: float | None, limit: float) -> float | None:
    """``value`` if it is a number of at most ``limit`` in size; NaN fails every comparison."""
    return value if value is not None and abs(value) <= limit else None
