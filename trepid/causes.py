"""The vocabulary of causes: the reasons that a decision, a rule file, the settings and a scenario may name.

The causes of the code and of ``config/fear.yaml`` are :class:`Cause`. A rule file may declare further ones under
``causes``; these are known in that file and wherever its rules are used.
"""

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


CAUSES: frozenset[str] = frozenset(cause.value for cause in Cause)


def unknown_cause(name: str, known: Collection[str] = CAUSES) -> str:
    """Error text for a cause that is not in ``known``, with the nearest known one; "" for a known cause."""
    return "" if name in known else f"unknown cause {name!r}; {did_you_mean(name, sorted(known))}"


def known_causes(declared: Iterable[str] = ()) -> frozenset[str]:
    """The vocabulary where a rule file that declares the causes ``declared`` is used."""
    return CAUSES.union(declared)
