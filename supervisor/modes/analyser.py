"""The cause of fear and the part of the car or the road in which it lies.

The fear rules rate symptoms too ("the confidence is low"). The analyser traces a symptom back to its cause, in the
order of causation: no data, a blind camera, traffic in the way, contradicting estimators, and last the road itself.
The first suspect with enough evidence is the cause.

It is a pure function of the features, like the rules, and takes a few microseconds (inventory F06, F08).
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from supervisor.inputs.validation import is_frozen
from supervisor.situation.features import DOUBT, Features
from trepid.causes import Cause
from trepid.config import Settings
from trepid.messages import QUANTITIES
from trepid.types import Positive, PositiveShare


class AnalyserSettings(Settings):
    """Section ``analyser`` of ``config/supervisor.yaml``: from where on a number is evidence."""

    former_names: ClassVar = {"frozen_s": ("reported_frozen_s",)}

    stale_s: Positive  # age of the newest frame, or of the vehicle's state
    behind_s: Positive  # one estimator behind the other: it has missed a frame
    dark: PositiveShare  # brightness below
    under_exposed: PositiveShare  # share of black pixels above
    over_exposed: PositiveShare  # share of white pixels above
    reported_frozen_s: Positive  # no new image for longer ...
    moving_mps: Positive  # ... while the car moves at least so fast
    blurred: Positive  # sharpness below [grey²]
    flat: PositiveShare  # contrast below
    spots: PositiveShare  # share of spotted tiles above
    occluding_m: Positive  # a vehicle ahead nearer than this hides the road ...
    occluding_s: Positive  # ... or at a time gap less than this
    unsure: PositiveShare  # confidence below: the road is hard to see
    blind: PositiveShare  # ... the road is not detected
    weak_edges: (
        PositiveShare  # confidence below which edges of one estimator only, without lines, are no road
    )
    disagreement_mps2: Positive
    separation_m: Positive


class Finding(NamedTuple):
    """A cause and the part in which it lies."""

    cause: str  # "" when nothing is
    part: str  # "camera", "lens", "traffic", "road", "vehicle", the name of an estimator, "perception"


NOTHING = Finding("", "")
Evidence = Callable[[Features, AnalyserSettings], bool]


@dataclass(frozen=True, slots=True)
class Suspect:
    """One row of the table: a cause, the part in which it lies, and its evidence."""

    cause: Cause
    part: str
    evidence: Evidence
    because: str


def _above(name: str, limit: str) -> Evidence:
    return lambda x, s: _number(x[name]) > getattr(s, limit)


def _below(name: str, limit: str) -> Evidence:
    return lambda x, s: _number(x[name]) < getattr(s, limit)


def _any(*pieces: Evidence) -> Evidence:
    return lambda x, s: any(piece(x, s) for piece in pieces)


def _lost(name: str) -> Evidence:
    return lambda x, s: x[name] is None or not math.isfinite(_number(x[name]))


def _behind(x: Features, s: AnalyserSettings) -> bool:
    """One estimator is a frame behind another, or has not sent any message."""
    return _lost("estimator_age")(x, s) or _number(x["estimator_age"]) - _number(x["frame_age"]) > s.behind_s


def is_image_late(x: Features, s: AnalyserSettings) -> bool:
    """No new image comes while the car moves."""
    return is_frozen(
        x["frozen"], x["speed"], after_s=s.reported_frozen_s, from_mps=s.moving_mps, if_unknown=False
    )


def _unseen(x: Features, s: AnalyserSettings) -> bool:
    """The road is hard to see, also where the confidence is unknown."""
    return not _number(x["seen_confidence"]) >= s.unsure


def _is_occluded(x: Features, s: AnalyserSettings) -> bool:
    near = _number(x["lead_distance"]) < s.occluding_m or _number(x["time_gap"]) < s.occluding_s
    return near and _unseen(x, s)


def _without_lines(x: Features, _: AnalyserSettings) -> bool:
    return _number(x["unmarked"]) > 0.5


def _nowhere(x: Features, s: AnalyserSettings) -> bool:
    """No estimator detects a road, or only one does, from weak edges: a field, fallen snow."""
    weak = _without_lines(x, s) and _number(x["seen_confidence"]) < s.weak_edges
    return _number(x["seen_confidence"]) < s.blind or (weak and _number(x["second_confidence"]) < s.blind)


SUSPECTS = (
    Suspect(
        Cause.STALE_DATA, "camera", _any(_lost("frame_age"), _above("frame_age", "stale_s")), "no frame comes"
    ),
    Suspect(
        Cause.DOUBTED_STATE,
        "vehicle",
        lambda x, _: _number(x[DOUBT]) > 0.0,
        "a measurement of the vehicle is missing, or physics contradicts it",
    ),
    Suspect(
        Cause.VEHICLE_STATE_LOST,
        "vehicle",
        _any(_lost("speed"), _lost("state_age"), _above("state_age", "stale_s")),
        "speed or yaw rate of the vehicle are missing",
    ),
    Suspect(Cause.LOST_ESTIMATOR, "perception", _behind, "one estimator is a frame behind the other"),
    Suspect(Cause.IMAGE_STATISTICS_LOST, "perception", _lost("brightness"), "image statistics are missing"),
    Suspect(
        Cause.DARK,
        "camera",
        _any(_below("brightness", "dark"), _above("under_exposed", "under_exposed")),
        "hardly any light in the image",
    ),
    Suspect(
        Cause.OVER_EXPOSED, "camera", _above("over_exposed", "over_exposed"), "much of the image is white"
    ),
    Suspect(Cause.FROZEN_CAMERA, "camera", is_image_late, "the car moves and no new image comes"),
    Suspect(
        Cause.BLURRED,
        "camera",
        _any(_below("sharpness", "blurred"), _below("contrast", "flat")),
        "no edges and no contrast",
    ),
    Suspect(Cause.DIRTY_LENS, "lens", _above("spots", "spots"), "spots all over the image stand still"),
    Suspect(Cause.OCCLUDED, "traffic", _is_occluded, "the road is hard to see and a vehicle is in the way"),
    Suspect(
        Cause.DISAGREEMENT,
        "perception",
        _any(_above("disagreement", "disagreement_mps2"), _above("separation", "separation_m")),
        "the estimators measure different roads",
    ),
    Suspect(Cause.NO_ROAD, "road", _nowhere, "no road is measured, or only unconfirmed weak edges"),
    Suspect(Cause.UNMARKED, "road", _without_lines, "edges are measured, but no lines"),
    Suspect(Cause.LOW_CONFIDENCE, "road", _unseen, "the road is hard to see"),
)
"""In the order of causation: the first row with evidence is the cause."""

SIGHT = "sight"
"""Cause of the rules about the input of this name, which the image statistics resolve."""

SYMPTOMS = frozenset(
    {
        *(Cause.LOW_CONFIDENCE, Cause.UNCONFIRMED, Cause.NO_ROAD, Cause.DISAGREEMENT),
        *(Cause.SINGLE_SOURCE, Cause.JITTER, Cause.LANE_WIDTH),
    }
)
"""Causes of fear rules that may have another cause, which the analyser finds."""


def analyse(
    x: Features,
    settings: AnalyserSettings,
    *,
    ages_s: Mapping[str, float],
    doubted: Collection[str] = (),
) -> Finding:
    """The first suspect with enough evidence in the features ``x``.

    Of estimators the late one is named by ``ages_s``, of measurements those in ``doubted``, fields of the state.
    """
    for suspect in SUSPECTS:
        if suspect.evidence(x, settings):
            part = suspect.part
            if suspect.cause is Cause.LOST_ESTIMATOR:
                part = max(ages_s, key=lambda name: ages_s[name])
            if suspect.cause is Cause.DOUBTED_STATE:
                part = field_names(doubted) or part
            return Finding(suspect.cause, part)
    return NOTHING


def field_names(doubted: Collection[str]) -> str:
    """The names of the fields ``doubted`` of the vehicle state, such as ``speed, yaw rate``."""
    return ", ".join(QUANTITIES.get(field, field) for field in doubted)


def traced_cause(cause: str, finding: Finding, sight_cause: str = "") -> str:
    """The cause of fear, traced back: a symptom gives way to the finding that accounts for it.

    A rule about ``sight`` gives way to what ends the sight.
    """
    if cause == SIGHT:
        return sight_cause or cause
    return finding.cause if finding.cause and cause in SYMPTOMS else cause


def _number(value: float | None) -> float:
    """The value; NaN, which compares with nothing, for None."""
    return math.nan if value is None else value
