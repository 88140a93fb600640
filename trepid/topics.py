"""Every topic of Trepid, in one table. Keys stand below ``trepid/<vehicle-name>/``."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from trepid import messages

M = TypeVar("M")


@dataclass(frozen=True, slots=True)
class Topic(Generic[M]):
    """A key expression and its message type."""

    key: str
    type: type[M]
    rate_hz: float
    urgent: bool = True  # has priority over images and diagnostics


CAMERA_IMAGE = Topic("camera/image", messages.Frame, 25, urgent=False)  # camera -> perception
# camera -> recorder, page
CAMERA_COMPRESSED = Topic("camera/image/compressed", messages.CompressedFrame, 25, urgent=False)
IMAGE_STATISTICS = Topic("perception/image_statistics", messages.ImageStatistics, 25)  # -> supervisor
LEAD_VEHICLE = Topic("perception/lead", messages.LeadVehicle, 25)  # -> supervisor
ROAD_USERS = Topic("perception/road_users", messages.RoadUsers, 25)  # -> supervisor
DECISION = Topic("supervisor/decision", messages.Decision, 25)  # -> controller
COMMAND = Topic("controller/command", messages.Command, 50)  # -> vehicle
VEHICLE_STATE = Topic("vehicle/state", messages.VehicleState, 100)  # -> all
DRIVER_INPUT = Topic("driver/input", messages.DriverInput, 50)  # game pad or keyboard -> vehicle
STOP_REQUEST = Topic("driver/stop", messages.StopRequest, 1)  # stop button of the page -> vehicle
SIM_TRUTH = Topic("sim/truth", messages.SimTruth, 100)  # simulated vehicle -> simulated camera, referee
DIAGNOSTICS = Topic("diagnostics", messages.Diagnostic, 1, urgent=False)  # every process -> launcher
LOSSES = Topic("drive/losses", messages.Losses, 1)  # launcher -> supervisor, controller, simulated vehicle
TIMING = Topic("diagnostics/timing", messages.Timing, 1, urgent=False)  # processes of the frame -> launcher
STEPS = Topic("diagnostics/steps", messages.Steps, 1, urgent=False)  # nodes with inputs -> recorder

FIXED = {topic.key: topic for topic in list(globals().values()) if isinstance(topic, Topic)}


def estimate_topic(name: str) -> Topic[messages.SteeringEstimate]:
    """Topic on which the estimator called ``name`` publishes, for the supervisor."""
    return Topic(f"perception/{name}/estimate", messages.SteeringEstimate, 25)


def topic_of(key: str) -> Topic[Any] | None:
    """The topic with this key, or None when there is none."""
    parts = key.split("/")
    if len(parts) == 3 and parts[0] == "perception" and parts[2] == "estimate":
        return estimate_topic(parts[1])
    return FIXED.get(key)
