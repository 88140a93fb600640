"""Which law steers: ``lateral`` in ``config/controller.yaml``."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from controller.lateral_feedforward import Feedforward, FeedforwardSettings
from controller.lateral_lqi import Lqi, LqiSettings
from controller.law import LateralLaw
from controller.pure_pursuit import PurePursuit, PurePursuitSettings
from controller.stanley import Stanley, StanleySettings
from trepid.config import Settings
from trepid.vehicle import NonNegative, Vehicle


class LawName(StrEnum):
    """The lateral laws."""

    FEEDFORWARD = "feedforward"
    LQI = "lqi"
    PURE_PURSUIT = "pure_pursuit"
    STANLEY = "stanley"


class LateralSettings(Settings):
    """``lateral`` in ``config/controller.yaml``: the law that steers, and a section for each."""

    law: LawName
    command_delay_s: NonNegative  # from the controller to the actuator, mean hold of the command included
    timing_share: Annotated[float, Field(ge=0, lt=1)]  # of dead time and lag, that is learned; 0: nothing is
    feedforward: FeedforwardSettings
    lqi: LqiSettings
    pure_pursuit: PurePursuitSettings
    stanley: StanleySettings


def build_law(settings: LateralSettings, vehicle: Vehicle) -> LateralLaw:
    """The law that ``settings`` names, for ``vehicle`` as it is believed to be."""
    match settings.law:
        case LawName.FEEDFORWARD:
            return Feedforward(settings.feedforward, vehicle)
        case LawName.LQI:
            return Lqi(settings.lqi, vehicle, command_delay_s=settings.command_delay_s)
        case LawName.PURE_PURSUIT:
            return PurePursuit(settings.pure_pursuit)
        case LawName.STANLEY:
            return Stanley(settings.stanley, vehicle)
