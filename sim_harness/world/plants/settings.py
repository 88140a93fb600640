"""Settings of the simulated vehicle: its model, and how it differs from the vehicle file."""

from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, Field

from sim_harness.world.plants.springs import Springs
from trepid import plugins
from trepid.config import Settings
from trepid.spelling import did_you_mean
from trepid.types import NonNegative, OpenShare, Positive


class Model(StrEnum):
    """Vehicle models: two of Trepid from simple to detailed, and three of other packages."""

    KINEMATIC = "kinematic"
    SINGLE_TRACK = "single_track"
    COMMONROAD_DRIFT = "commonroad_drift"
    COMMONROAD_MULTI_BODY = "commonroad_multi_body"
    HIGHWAY_ENV = "highway_env"


def _is_known(model: Model | str) -> Model | str:
    known = plugins.names(plugins.Group.PLANTS, {each.value: each for each in Model})
    if model not in known:
        raise ValueError(f"unknown model {model!r}; {did_you_mean(str(model), known)}")
    return model


ModelName = Annotated[Model | str, Field(union_mode="left_to_right"), AfterValidator(_is_known)]
"""A model of Trepid, or the name of one that another package adds (entry points ``trepid.plants``)."""


class Chassis(Settings):
    """Mass and tyres, which the vehicle file does not contain: only the simulation needs them.

    The front tyres follow from the understeer gradient of the vehicle file.
    """

    mass_kg: Positive = 700.0  # GEM e2, about 550 kg, and two people
    front_share: OpenShare = 0.45  # of the mass on the front axle; the batteries stand under the seats
    yaw_inertia_index: Positive = 1.0  # I_z/(m·l_f·l_r); typical of cars, to be measured
    # C_r/F_zr of the unloaded axle: near p_ky1 = 21.9 of the tyres of CommonRoad's vehicles (ADAMS handbook).
    rear_stiffness_per_rad: Positive = 20.0
    load_front_share: Annotated[float, Field(ge=0, le=1)] = 0.2  # of the load on the front axle: a cargo bed


class PlantSettings(Settings):
    """Differences between the simulated vehicle and the vehicle file of the controller; by default none."""

    model: ModelName = Model.KINEMATIC
    friction: Annotated[float, Field(gt=0, le=1.5)] = 1.0  # μ between tyres and road
    bank_rad: Annotated[float, Field(gt=-0.3, lt=0.3)] = 0.0  # of the road; + = left side up, pulls right
    load_kg: NonNegative = 0.0  # added to the mass of the vehicle; the tyre stiffness is unchanged
    # Tyre angle minus measured steering angle.
    steering_offset_rad: Annotated[float, Field(gt=-0.2, lt=0.2)] = 0.0
    steering_friction_rad: Annotated[float, Field(ge=0, lt=0.2)] = 0.0  # half-width of stick and play
    vehicle: dict[str, float] = Field(default_factory=dict)  # fields of the vehicle file to override
    chassis: Chassis = Chassis()
    springs: Springs | None = None  # of the body that carries the camera; None: it stays parallel to the road


AS_IN_THE_FILE = PlantSettings()  # the kinematic model of the vehicle file
