"""What is feared, as named numbers: the inputs that ``config/fear.yaml`` may speak of.

None is "lost or broken", which alone makes fear 1. What is honestly absent has a number: the calm one where its
absence is feared elsewhere (no vehicle ahead; no second estimate to disagree with, which is a low confidence), one
beyond the worst where it is not (no lane width, no path).
"""

import math
from collections.abc import Iterable
from operator import attrgetter

from supervisor.follow import Lead
from supervisor.fusion import Fused
from supervisor.lane import Motion
from supervisor.sightings import Sighting
from trepid.messages import ImageStatistics

BEYOND = 1e6  # beyond the range of any input
_CRAWL_MPS = 1.0  # time gaps are reckoned with at least this speed: at standstill any distance is enough

IMAGE_FEATURES = {
    "brightness": "brightness",
    "contrast": "contrast",
    "over_exposed": "over_exposed",
    "under_exposed": "under_exposed",
    "sharpness": "sharpness",
    "frozen": "frozen_s",
}
"""Name of the feature -> field of the image statistics."""
_STATISTICS, _LOST_STATISTICS = attrgetter(*IMAGE_FEATURES.values()), (None,) * len(IMAGE_FEATURES)
ESTIMATOR_SUFFIX = "_confidence"
FEATURES = frozenset(
    {
        *("frame_age", "estimator_age", "state_age", "lane_confidence", "lane_width_error"),
        *("disagreement", "separation"),
        *IMAGE_FEATURES,
        *("speed", "lateral_demand", "lateral_error", "lead_confidence", "time_gap"),
    }
)
"""Besides these there is ``<estimator>_confidence`` for every estimator."""

Features = dict[str, float | None]


def features(
    sightings: list[Sighting],
    fused: Fused,
    statistics: ImageStatistics | None,
    lead: Lead,
    motion: Motion | None,
    *,
    state_age_s: float,
    expected: Iterable[str] = (),
) -> Features:
    """Every input by name. ``statistics`` must be fresh or None; ``motion`` is None when the state is lost.

    ``expected`` names further confidences that the rules speak of: an estimator that does not run has none.
    """
    speed_mps = None if motion is None else abs(motion.speed_mps)
    ages = [s.age_s for s in sightings]
    known = [s.confidence for s in sightings if s.confidence is not None]
    found: Features = dict.fromkeys(expected, 0.0)
    for s in sightings:
        found[s.estimator + ESTIMATOR_SUFFIX] = s.confidence
    found["frame_age"] = min(ages) if ages else None
    found["estimator_age"] = max(ages) if ages else None
    found["state_age"] = math.inf if motion is None else state_age_s  # no finite number is feared as missing
    found["lane_confidence"] = max(known) if known else None
    found["disagreement"], found["separation"] = _contradiction(sightings, fused, speed_mps)
    found["lane_width_error"] = _lane_width_error(sightings)
    found["speed"] = speed_mps
    found["lateral_demand"], found["lateral_error"] = _path(fused, speed_mps)
    found["lead_confidence"] = lead.confidence
    found["time_gap"] = _time_gap(lead, speed_mps)
    numbers = _LOST_STATISTICS if statistics is None else _STATISTICS(statistics)
    found.update(zip(IMAGE_FEATURES, numbers, strict=True))
    return found


def _contradiction(
    sightings: list[Sighting], fused: Fused, speed_mps: float | None
) -> tuple[float | None, float | None]:
    """How far the estimates contradict each other [m/s², m]; unknown when one of them is broken."""
    if speed_mps is None or True in [s.broken for s in sightings]:
        return None, None
    return fused.weighted_disagreement_mps2, fused.weighted_separation_m


def _lane_width_error(sightings: list[Sighting]) -> float:
    """The greatest, over the estimators that see boundaries."""
    errors = [BEYOND if s.width_error_m is None else s.width_error_m for s in sightings if s.measures_width]
    return max(errors) if errors else BEYOND


def _path(fused: Fused, speed_mps: float | None) -> tuple[float | None, float]:
    """What the path asks of the tyres [m/s²], and how far off it the car is [m]."""
    if fused.path is None:
        return BEYOND, BEYOND
    lane = fused.path.lane
    demand = None if speed_mps is None else abs(lane.curvature_1pm) * speed_mps**2
    return demand, abs(lane.offset_m)


def _time_gap(lead: Lead, speed_mps: float | None) -> float | None:
    if lead.confidence is None or speed_mps is None:
        return None
    return BEYOND if lead.distance_m is None else lead.distance_m / max(speed_mps, _CRAWL_MPS)
