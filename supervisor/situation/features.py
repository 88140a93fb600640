"""The features: the inputs that ``config/fear.yaml`` may name. Reasons: ``docs/fear_terms.md``.

None means "lost or broken" and makes fear 1. A valid absence has a number: the calm one where another feature
raises fear for it (no vehicle ahead; no second estimate, which is a low confidence; no offset of a steering angle,
which is an unknown lane width), one beyond the worst where none does (no lane width, no path).
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from operator import attrgetter, itemgetter

from supervisor.inputs.consistency import EdgeWay, Steadiness
from supervisor.inputs.validation import ValidatedEstimate, surest_of_marking
from supervisor.path.follow import Lead
from supervisor.path.fusion import FusionResult
from supervisor.path.giving_way import Way
from supervisor.rules.rule_file import FORMER_PATH_JITTER
from supervisor.situation.added import (
    CONFIDENCE,
    ESTIMATOR_SUFFIXES,
    JITTER,
    PATH_JITTER,
    SUPPORT,
    added_names,
)
from trepid.bounds import at_least, at_most
from trepid.clothoid import Motion
from trepid.messages import ImageStatistics
from trepid.spelling import did_you_mean

BEYOND = 1e6  # beyond the range of any input
UNKNOWN_ERROR_M = 10.0  # of the width of a lane: that of some lanes, which a surer estimator can outweigh
_CRAWL_MPS = 1.0  # least speed in the computation of a time gap: at standstill any distance is enough

IMAGE_FEATURES = {
    "brightness": "brightness",
    "contrast": "contrast",
    "over_exposed": "over_exposed",
    "under_exposed": "under_exposed",
    "sharpness": "sharpness",
    "frozen": "frozen_s",
    "spots": "spots",
}
"""Name of the feature -> field of the image statistics."""
_STATISTICS, _LOST_STATISTICS = attrgetter(*IMAGE_FEATURES.values()), (None,) * len(IMAGE_FEATURES)
EARLY_FEATURES = frozenset(
    {
        *("frame_age", "estimator_age", "state_age", "state_doubt", "speed", "saturated", "turn_excess"),
        *IMAGE_FEATURES,
        "relative_contrast",
        *("lane_width", "lane_width_error", "unmarked", "unmarked_way", "edge_doubt"),
        *("lead_confidence", "lead_distance", "time_gap", "lead_deceleration"),
    }
)
"""Features that do not depend on the fusion; the rules of trust may use these only."""
FEATURES = EARLY_FEATURES | {
    *(
        "lane_confidence",
        "second_confidence",
        "seen_confidence",
        "disagreement",
        "separation",
        "single_source",
    ),
    *("lateral_demand", "lateral_error", "crossing", "sight", "person_time", "person_margin"),
}
"""Further features belong to the estimators: the name that rates an estimator and one of ESTIMATOR_SUFFIXES."""

DOUBT = "state_doubt"
Features = dict[str, float | None]


UNITS = {
    "s": (
        "frame_age",
        "estimator_age",
        "state_age",
        "single_source",
        "frozen",
        "crossing",
        "saturated",
        "time_gap",
    ),
    "m": ("separation", "lane_width_error", "lane_width", "unmarked_way", "lateral_error", "lead_distance"),
    "m/s": ("speed", "person_margin"),
    "m/s²": ("disagreement", "lateral_demand", "turn_excess", "lead_deceleration"),
    "grey²": ("sharpness",),
}
"""Unit -> features in it."""


def wrong_units(units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Each input whose unit in ``units`` is not that of its values, with the fault."""
    of = {name: unit for unit, names in UNITS.items() for name in names}
    for name, unit in units.items():
        expected = of.get(name, unit)
        if unit != expected:
            yield name, f"{name} is measured in {expected}, not in {unit}; its sets hold in {expected}"


def unknown_features(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Each of ``names`` that is no feature, with the nearest one as a question."""
    for name in names:
        if name in FEATURES or name.endswith(ESTIMATOR_SUFFIXES) or name in added_names():
            continue
        yield name, did_you_mean(name, FEATURES | added_names())


def early_features(
    estimates: list[ValidatedEstimate],
    statistics: ImageStatistics | None,
    lead: Lead,
    motion: Motion | None,
    *,
    state_age_s: float,
    state_doubt: float | None,
    steadiness: Mapping[str, Steadiness],
    edges: EdgeWay,
    saturated_s: float,
    turn_excess_mps2: float,
    enlargement: float,
    rated_as: Mapping[str, str],
    absent: Mapping[str, float | None],
) -> Features:
    """EARLY_FEATURES and those of every estimator. ``statistics`` must be fresh or None, ``motion`` None when lost.

    ``rated_as`` maps an estimator to the name in its features, which several may share (:func:`rating_features`).
    ``absent`` contains the features of names that rate no running estimator.
    """
    speed_mps = None if motion is None else abs(motion.speed_mps)
    ages = [s.age_s for s in estimates]
    found: Features = dict(absent)
    for name in dict.fromkeys(rated_as.values()):
        found |= rating_features(name, [e for e in estimates if rated_as[e.estimator] == name], steadiness)
    found["frame_age"] = min(ages) if ages else None
    found["estimator_age"] = max(ages) if ages else None
    found["state_age"] = math.inf if motion is None else state_age_s  # inf: missing, which makes fear 1
    found[DOUBT] = state_doubt
    found["speed"] = speed_mps
    found["saturated"] = saturated_s
    found["turn_excess"] = turn_excess_mps2
    found["lane_width"] = narrowest_m(estimates)
    found["lane_width_error"] = _lane_width_error(estimates)
    found["unmarked"] = _unmarked_degree(estimates)
    found["unmarked_way"] = edges.unmarked_m
    found["edge_doubt"] = edges.doubt
    found["lead_confidence"] = lead.confidence
    found["lead_distance"] = _lead_distance(lead)
    found["time_gap"] = _time_gap(lead, speed_mps)
    found["lead_deceleration"] = _lead_deceleration_mps2(lead, speed_mps, enlargement)
    numbers = _LOST_STATISTICS if statistics is None else _STATISTICS(statistics)
    found.update(zip(IMAGE_FEATURES, numbers, strict=True))
    found["relative_contrast"] = _relative_contrast(statistics)
    return found


def _relative_contrast(statistics: ImageStatistics | None) -> float | None:
    """Standard deviation of grey over its mean: a contrast that exposure does not change; 0 of a black image."""
    if statistics is None:
        return None
    return statistics.contrast / statistics.brightness if statistics.brightness != 0.0 else 0.0


def rating_features(name: str, rated: list[ValidatedEstimate], steady: Mapping[str, Steadiness]) -> Features:
    """The features by which the rules rate the estimators ``rated`` under one ``name``.

    The confidence is that of the surest; one that contradicts it raises fear by disagreement and separation.
    Jitters are drawn as in :func:`_lane_width_error`. A broken one makes all None, a lost one the confidence.
    """
    sure = [e.confidence or 0.0 for e in rated]
    jitters_m = zip(*[steady[e.estimator] for e in rated], strict=True)
    jitter_m, path_jitter_m = (max(_by_confidence(list(zip(each, sure, strict=True)))) for each in jitters_m)
    confidence = None if None in [e.confidence for e in rated] else max(sure)
    found: Features = dict.fromkeys((name + PATH_JITTER, name + FORMER_PATH_JITTER), path_jitter_m)
    found |= {name + CONFIDENCE: confidence, name + JITTER: jitter_m}
    return dict.fromkeys(found) if any(e.broken for e in rated) else found


def features(
    early: Features,
    estimates: list[ValidatedEstimate],
    fused: FusionResult,
    motion: Motion | None,
    *,
    trust: Mapping[str, float],
    rated_as: Mapping[str, str],
    single_source_s: float,
    half_width_m: float,
    way: Way | None,
    enlargement: float = 1.0,
) -> Features:
    """Every input by name: ``early`` and the features that depend on the fusion.

    ``trust`` is the factor of the confidence of each estimator, 1 for estimators without one, ``rated_as`` its name
    in the features; ``half_width_m`` is half the width of the vehicle, ``way`` what road users leave to it, None
    where they are lost.
    ``enlargement`` is that of the reference world relative to the world of the car.
    Tyres and gravity do not scale (:mod:`trepid.scale`): the lateral demand is rated in the world of the car.
    """
    speed_mps = early["speed"]
    trusted = [(s, s.confidence * trust.get(s.estimator, 1.0)) for s in estimates if s.confidence is not None]
    found = dict(early)
    for s, confidence in trusted:  # a view that the fusion rejects supports nothing
        held = confidence if s.estimator in fused.sources else 0.0
        name = rated_as[s.estimator] + SUPPORT
        found[name] = at_least(held, found.get(name) or 0.0)
    found["lane_confidence"] = max([c for _, c in trusted]) if trusted else None
    found["second_confidence"] = sorted([0.0, 0.0, *[c for _, c in trusted]])[-2] if trusted else None
    found["seen_confidence"] = max([0.0 if s.from_memory else c for s, c in trusted]) if trusted else None
    found["disagreement"], found["separation"] = _contradiction(estimates, fused, speed_mps)
    found["single_source"] = single_source_s
    found["lateral_demand"], found["lateral_error"] = _path(fused, speed_mps, enlargement)
    # An unknown width of a measured lane counts as the narrowest lane: no room at all.
    room_m = narrowest_m(estimates, unknown_m=0.0)
    found["crossing"] = _crossing_s(fused, motion, room_m, half_width_m)
    found["person_time"] = None if way is None else at_most(way.time_s, BEYOND)
    found["person_margin"] = _person_margin_mps(way, speed_mps)
    return found


def _contradiction(
    estimates: list[ValidatedEstimate], fused: FusionResult, speed_mps: float | None
) -> tuple[float | None, float | None]:
    """Weighted disagreement [m/s²] and separation [m] of the estimates; None when one of them is broken."""
    if speed_mps is None or True in [s.broken for s in estimates]:
        return None, None
    return fused.weighted_disagreement_mps2, fused.weighted_separation_m


def _lane_width_error(estimates: list[ValidatedEstimate]) -> float:
    """The greatest of the estimators that measure boundaries, each drawn towards that of the surest of them.

    With the confidence c of an estimator and c* of the surest, whose error is x*, its error x counts as
    x* + (x - x*)·c/c*: a boundary that is probably wrong says little about the width of the lane. An unknown width
    is BEYOND, of an estimator less sure than another UNKNOWN_ERROR_M.
    """
    measured = [(s.width_error_m, s.confidence or 0.0) for s in estimates if s.measures_width]
    greatest = max([c for _, c in measured], default=0.0)
    found = [((BEYOND if c >= greatest else UNKNOWN_ERROR_M) if x is None else x, c) for x, c in measured]
    return max(_by_confidence(found), default=BEYOND)


def narrowest_m(estimates: list[ValidatedEstimate], unknown_m: float | None = None) -> float:
    """The least width of the estimators that measure boundaries, each drawn as that of :func:`_lane_width_error`.

    An unknown width counts as ``unknown_m``, or not at all. BEYOND where there is none, for which lane_width_error
    raises fear.
    """
    widths_m = [
        (unknown_m if s.width_m is None else s.width_m, s.confidence or 0.0)
        for s in estimates
        if s.measures_width
    ]
    return min(_by_confidence([(width, c) for width, c in widths_m if width is not None]), default=BEYOND)


def _by_confidence(found: list[tuple[float, float]]) -> list[float]:
    """Each value of (value, confidence), drawn towards the one of the greatest confidence by their shares."""
    if not found:
        return []
    surest, greatest = max(found, key=itemgetter(1))
    return [
        value if value == surest or c >= greatest else surest + (value - surest) * c / greatest
        for value, c in found
    ]


def _unmarked_degree(estimates: list[ValidatedEstimate]) -> float:
    """1 where the surest estimator that distinguishes them measures edges, not lines; 0 without one."""
    surest = surest_of_marking(estimates)
    return 1.0 if surest is not None and not surest.marked else 0.0


def _path(fused: FusionResult, speed_mps: float | None, enlargement: float) -> tuple[float | None, float]:
    """Lateral acceleration on the path [m/s²] of the car's own world, and distance of the car from it [m]."""
    if fused.path is None:
        return BEYOND, BEYOND
    lane = fused.path.lane
    demand = None if speed_mps is None else abs(lane.curvature_1pm) * speed_mps**2 / enlargement
    return demand, abs(lane.offset_m) if fused.path.measured else 0.0


def _crossing_s(
    fused: FusionResult, motion: Motion | None, lane_width_m: float | None, half_width_m: float
) -> float | None:
    """Time until a wheel crosses the edge of the lane if heading and yaw rate stay as they are [s].

    In the frame of the lane e(t) = e + v·ψ·t + (v·ω - κ·v²)·t²/2 (Mammar et al., Time to line crossing for lane
    departure avoidance, IEEE Trans. ITS 7 (2006), with constant yaw rate). None when the motion is lost; BEYOND
    without a path or a width, for which other features raise fear, and when no wheel crosses.
    """
    if motion is None:
        return None
    if fused.path is None or lane_width_m is None or lane_width_m >= BEYOND:
        return BEYOND
    lane, speed_mps = fused.path.lane, motion.speed_mps
    room_m = at_least(lane_width_m / 2 - half_width_m, 0.0)
    drift_mps = speed_mps * lane.heading_rad
    bend_mps2 = speed_mps * motion.yaw_rate_radps - lane.curvature_1pm * speed_mps**2
    left = first_root(room_m - lane.offset_m, drift_mps, bend_mps2)
    return min(left, first_root(room_m + lane.offset_m, -drift_mps, -bend_mps2))


def first_root(room_m: float, drift_mps: float, bend_mps2: float) -> float:
    """The least t >= 0 with drift·t + bend·t²/2 = room; BEYOND when there is none."""
    if room_m <= 0.0:
        return 0.0
    if abs(bend_mps2) < 1e-9:
        return room_m / drift_mps if drift_mps > 0 else BEYOND
    under_root = drift_mps**2 + 2 * bend_mps2 * room_m
    if under_root < 0:
        return BEYOND
    # Without cancellation for a small bend: room = t·(drift + sqrt(...))/2.
    towards = drift_mps + math.sqrt(under_root)
    return 2 * room_m / towards if towards > 0 else BEYOND


def _person_margin_mps(way: Way | None, speed_mps: float | None) -> float | None:
    """Speed [m/s] by which the car is slower than road users permit, negative where it is faster."""
    return None if way is None or speed_mps is None else at_most(way.cap_mps - speed_mps, BEYOND)


def _lead_distance(lead: Lead) -> float | None:
    """Length of road visible before the vehicle ahead [m]; BEYOND without one."""
    if lead.confidence is None:
        return None
    return BEYOND if lead.distance_m is None else lead.distance_m


def _time_gap(lead: Lead, speed_mps: float | None) -> float | None:
    if lead.confidence is None or speed_mps is None:
        return None
    return BEYOND if lead.distance_m is None else lead.distance_m / max(speed_mps, _CRAWL_MPS)


def _lead_deceleration_mps2(lead: Lead, speed_mps: float | None, enlargement: float) -> float | None:
    """The constant deceleration that avoids a vehicle ahead of constant speed [m/s²] of the car's own world.

    DRAC = (v - v_lead)²/(2·gap), 0 where the gap does not close, times the confidence in the vehicle. Source:
    Archer, Indicators for traffic safety assessment and prediction, 2005, section 3.
    """
    if lead.confidence is None or speed_mps is None:
        return None
    closing_mps = at_least(speed_mps - lead.speed_mps, 0.0)
    if lead.distance_m is None or closing_mps == 0.0:
        return 0.0
    if lead.distance_m <= 0.0:
        return BEYOND
    return lead.confidence * closing_mps**2 / (2.0 * lead.distance_m) / enlargement
