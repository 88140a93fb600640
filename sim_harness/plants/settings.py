"""What moves the simulated vehicle: which model, and how reality differs from the vehicle file."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from trepid.config import Settings

NonNegative = Annotated[float, Field(ge=0)]


class Model(StrEnum):
    """The vehicle models, from the simplest to the most detailed, and a foreign one."""

    KINEMATIC = "kinematic"
    SINGLE_TRACK = "single_track"
    COMMONROAD_DRIFT = "commonroad_drift"
    COMMONROAD_MULTI_BODY = "commonroad_multi_body"
    HIGHWAY_ENV = "highway_env"


class PlantSettings(Settings):
    """How the simulated vehicle differs from what the controller believes; the default differs in nothing."""

    model: Model = Model.KINEMATIC
    friction: Annotated[float, Field(gt=0, le=1.5)] = 1.0  # μ between tyres and road
    bank_rad: Annotated[float, Field(gt=-0.3, lt=0.3)] = (
        0.0  # of the road; + = left side up, pulls to the right
    )
    load_kg: NonNegative = 0.0  # on top of the mass of the vehicle
    steering_offset_rad: Annotated[float, Field(gt=-0.2, lt=0.2)] = 0.0  # tyres minus what the steering knows
    steering_friction_rad: Annotated[float, Field(ge=0, lt=0.2)] = 0.0  # half-width of stick and play
    vehicle: dict[str, float] = {}  # fields of the vehicle file that are different in reality
