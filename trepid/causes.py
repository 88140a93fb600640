"""The vocabulary of causes: the reasons that a decision, a rule file, the settings and a scenario may name.

The causes of the code and of ``config/fear.yaml`` are :class:`Cause`. A rule file may declare further ones under
``causes``; these are known in that file and wherever its rules are used.
"""

import math
from collections.abc import Collection, Iterable
from enum import StrEnum

from trepid.spelling import did_you_mean


class Cause(StrEnum):
    """A cause of fear or of a stop. Messages, traces and files carry its value."""

    NONE = "none"  # fear is at its lowest level
    STARTING = "starting"  # the stop in which every supervisor begins, also after a restart on the move
    DRIVER_OVERRIDE = "driver_override"
    STOP_BUTTON = "stop_button"  # a person stops the car
    NO_RULE = "no_rule"  # no rule holds: fear is 1
    MISSING_DATA = "missing_data"  # an input without a value, where the rule file names no other cause

    # messages
    STALE_DATA = "stale_data"
    LOST_ESTIMATOR = "lost_estimator"
    VEHICLE_STATE_LOST = "vehicle_state_lost"
    IMAGE_STATISTICS_LOST = "image_statistics_lost"
    LEAD_LOST = "lead_lost"
    ROAD_USERS_LOST = "road_users_lost"  # the detector of people, cyclists and animals
    LOST_PROCESS = "lost_process"  # reported by the launcher; also a requested end of a drive on the move

    # the image
    DARK = "dark"
    OVER_EXPOSED = "over_exposed"
    FROZEN_CAMERA = "frozen_camera"
    BLURRED = "blurred"
    DIRTY_LENS = "dirty_lens"

    # the distance that the image shows
    FOG = "fog"  # fog, rain, spray or snow in the air
    CREST = "crest"
    SIGHT_UNKNOWN = "sight_unknown"  # no image states how far it shows the road

    # the road and its estimates
    OCCLUDED = "occluded"
    DISAGREEMENT = "disagreement"
    NO_ROAD = "no_road"
    UNMARKED = "unmarked"
    LOW_CONFIDENCE = "low_confidence"
    UNCONFIRMED = "unconfirmed"
    SINGLE_SOURCE = "single_source"
    JITTER = "jitter"
    ODD_ROAD = "odd_road"
    WEAK_EDGES = "weak_edges"
    LANE_WIDTH = "lane_width"
    NARROW = "narrow"

    # the motion of the vehicle and the traffic
    OFF_CENTRE = "off_centre"
    DEMAND = "demand"
    SATURATED = "saturated"
    LEAD_CLOSE = "lead_close"
    PERSON = "person"  # a person, cyclist or animal on the way of the car, or beside it

    # what the vehicle reports
    DOUBTED_STATE = "doubted_state"  # a measurement that is missing, or that physics contradicts


def concerning(cause: str, part: str) -> str:
    """The text of ``cause`` with the part that it concerns, such as ``doubted_state (yaw rate)``."""
    return f"{cause} ({part})" if part else cause


IN_WORDS: dict[str, str] = {
    Cause.NONE: "no cause",
    Cause.STARTING: "starting",
    Cause.DRIVER_OVERRIDE: "the driver has the car",
    Cause.STOP_BUTTON: "STOP pressed",
    Cause.NO_RULE: "no rule holds",
    Cause.MISSING_DATA: "missing data",
    Cause.STALE_DATA: "no new image",
    Cause.LOST_ESTIMATOR: "late or lost estimator",
    Cause.VEHICLE_STATE_LOST: "no state of the vehicle",
    Cause.IMAGE_STATISTICS_LOST: "no image statistics",
    Cause.LEAD_LOST: "detector of vehicles lost",
    Cause.ROAD_USERS_LOST: "detector of people lost",
    Cause.LOST_PROCESS: "lost process",
    Cause.DARK: "dark image",
    Cause.OVER_EXPOSED: "dazzled camera",
    Cause.FROZEN_CAMERA: "frozen image",
    Cause.BLURRED: "blurred image",
    Cause.DIRTY_LENS: "dirty lens",
    Cause.FOG: "fog, rain or snow",
    Cause.CREST: "crest ahead",
    Cause.SIGHT_UNKNOWN: "unknown sight",
    Cause.OCCLUDED: "view blocked by a vehicle",
    Cause.DISAGREEMENT: "contradicting estimators",
    Cause.NO_ROAD: "no lane seen",
    Cause.UNMARKED: "no lane markings",
    Cause.LOW_CONFIDENCE: "lane hard to see",
    Cause.UNCONFIRMED: "lane not confirmed",
    Cause.SINGLE_SOURCE: "lane seen by one estimator only",
    Cause.JITTER: "unsteady lane",
    Cause.ODD_ROAD: "unusual road",
    Cause.WEAK_EDGES: "weak road edges",
    Cause.LANE_WIDTH: "unusual lane width",
    Cause.NARROW: "narrow lane",
    Cause.OFF_CENTRE: "off the lane centre",
    Cause.DEMAND: "sharp bend",
    Cause.SATURATED: "steering at its limit",
    Cause.LEAD_CLOSE: "vehicle ahead too near",
    Cause.PERSON: "person, cyclist or animal",
    Cause.DOUBTED_STATE: "doubted measurement",
}
"""Every cause as a driver says it."""


def in_words(cause: str, part: str = "") -> str:
    """``cause`` as a driver says it, with the part that it concerns; one of a rule file by its own name."""
    return concerning(IN_WORDS.get(cause, cause.replace("_", " ")), part)


def line_words(side: str) -> str:
    """The warning of ``Decision.line_warning`` as a driver says it; "" without one."""
    return side and f"a wheel is about to cross the {side} edge of the lane"


BRIEF_S = 0.3  # a lane that is not seen for a shorter time is no news
_NO_LANE = frozenset({Cause.NO_ROAD, Cause.UNCONFIRMED, Cause.LOW_CONFIDENCE})


def unseen(cause: str, unseen_s: float | None) -> str:
    """For how long no lane has been seen, where that is the ``cause``; "" else. None, inf: not seen so far."""
    if cause not in _NO_LANE or unseen_s is None or not BRIEF_S <= unseen_s < math.inf:
        return ""
    return f"no lane seen for {unseen_s:.1f} s"


CAUSES: frozenset[str] = frozenset(cause.value for cause in Cause)


def unknown_cause(name: str, known: Collection[str] = CAUSES) -> str:
    """Error text for a cause that is not in ``known``, with the nearest known one; "" for a known cause."""
    return "" if name in known else f"unknown cause {name!r}; {did_you_mean(name, sorted(known))}"


def known_causes(declared: Iterable[str] = ()) -> frozenset[str]:
    """The vocabulary where a rule file that declares the causes ``declared`` is used."""
    return CAUSES.union(declared)


NO_COMMAND = "no command arrives: the vehicle stops by itself, and waits for commands at standstill"
NO_SPEED = "no speed is measured: the vehicle stops by itself, and waits for a measured speed"
RESTART = "waits for a restart of the drive"
"""What a stop says that nothing ends by itself."""
OWN_STOPS = NO_COMMAND, NO_SPEED
"""What the vehicle process says while the limiter stops the car of its own accord."""
