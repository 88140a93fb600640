"""Every topic of Trepid, in one table. Keys stand below ``trepid/<vehicle-name>/``."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from trepid.messages import (
    Command,
    CompressedFrame,
    Decision,
    Diagnostic,
    Frame,
    ImageStatistics,
    LeadVehicle,
    SimTruth,
    SteeringEstimate,
    VehicleState,
)

M = TypeVar("M")


@dataclass(frozen=True, slots=True)
class Topic(Generic[M]):
    """A key expression and its message type."""

    key: str
    type: type[M]
    rate_hz: float
    flow: str  # publisher -> subscribers
    urgent: bool = True  # has priority over images and diagnostics


CAMERA_IMAGE = Topic("camera/image", Frame, 25, "camera -> perception", urgent=False)
CAMERA_COMPRESSED = Topic("camera/image/compressed", CompressedFrame, 10, "camera -> recorder", urgent=False)
IMAGE_STATISTICS = Topic("perception/image_statistics", ImageStatistics, 25, "perception -> supervisor")
LEAD_VEHICLE = Topic("perception/lead", LeadVehicle, 25, "perception -> supervisor")
DECISION = Topic("supervisor/decision", Decision, 25, "supervisor -> controller")
COMMAND = Topic("controller/command", Command, 50, "controller -> vehicle")
VEHICLE_STATE = Topic("vehicle/state", VehicleState, 100, "vehicle -> all")
SIM_TRUTH = Topic("sim/truth", SimTruth, 100, "simulated vehicle -> simulated camera, referee")
DIAGNOSTICS = Topic("diagnostics", Diagnostic, 1, "every process -> launcher", urgent=False)


FIXED = (
    CAMERA_IMAGE,
    CAMERA_COMPRESSED,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    DECISION,
    COMMAND,
    VEHICLE_STATE,
    SIM_TRUTH,
    DIAGNOSTICS,
)


def estimate_topic(name: str) -> Topic[SteeringEstimate]:
    """Topic on which the estimator called ``name`` publishes."""
    return Topic(f"perception/{name}/estimate", SteeringEstimate, 25, f"{name} -> supervisor")


def topic_of(key: str) -> Topic[Any] | None:
    """The topic with this key, or None when there is none."""
    parts = key.split("/")
    if len(parts) == 3 and parts[0] == "perception" and parts[2] == "estimate":
        return estimate_topic(parts[1])
    return next((topic for topic in FIXED if topic.key == key), None)
