"""Choice of the lateral law: ``lateral`` in ``config/controller.yaml``."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from controller.laws.feedforward import Feedforward, FeedforwardSettings
from controller.laws.law import LateralLaw
from controller.laws.lqi import Lqi
from controller.laws.lqi_settings import LqiSettings
from controller.laws.mpc import Mpc, MpcSettings
from controller.laws.pure_pursuit import PurePursuit, PurePursuitSettings
from controller.laws.stanley import Stanley, StanleySettings
from trepid.config import Settings
from trepid.types import NonNegative
from trepid.vehicle import Vehicle


class LawName(StrEnum):
    """The lateral laws."""

    FEEDFORWARD = "feedforward"
    LQI = "lqi"
    MPC = "mpc"
    PURE_PURSUIT = "pure_pursuit"
    STANLEY = "stanley"


class LateralSettings(Settings):
    """``lateral`` in ``config/controller.yaml``: the law that steers, and a section for each."""

    law: LawName
    command_delay_s: NonNegative  # from the controller to the actuator, mean hold of the command included
    timing_share: Annotated[
        float, Field(ge=0, lt=1)
    ]  # largest learned change of the delay, as a share of dead time plus lag; 0: none
    feedforward: FeedforwardSettings
    lqi: LqiSettings
    mpc: MpcSettings
    pure_pursuit: PurePursuitSettings
    stanley: StanleySettings


def build_law(settings: LateralSettings, vehicle: Vehicle) -> LateralLaw:
    """The law that ``settings`` names, for ``vehicle``."""
    match settings.law:
        case LawName.FEEDFORWARD:
            return Feedforward(settings.feedforward, vehicle)
        case LawName.LQI:
            return lqi(settings, vehicle)
        case LawName.MPC:
            fallback = lqi(settings, vehicle)
            return Mpc(settings.mpc, vehicle, command_delay_s=settings.command_delay_s, fallback=fallback)
        case LawName.PURE_PURSUIT:
            return PurePursuit(settings.pure_pursuit)
        case LawName.STANLEY:
            return Stanley(settings.stanley, vehicle)


def lqi(settings: LateralSettings, vehicle: Vehicle) -> Lqi:
    """The LQI law, also the fallback of :class:`controller.laws.mpc.Mpc`."""
    return Lqi(settings.lqi, vehicle, command_delay_s=settings.command_delay_s)
