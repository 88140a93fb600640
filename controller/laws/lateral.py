"""Choice of the lateral law: ``lateral`` in ``config/controller.yaml``."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from controller.laws.baselines import PurePursuit, PurePursuitSettings, Stanley, StanleySettings
from controller.laws.feedforward import Feedforward, FeedforwardSettings
from controller.laws.law import LateralLaw
from controller.laws.lqi import Lqi
from controller.laws.lqi_settings import LqiSettings
from controller.laws.mpc import Mpc, MpcSettings
from trepid.car.vehicle import Vehicle
from trepid.config import Settings
from trepid.types import NonNegative


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
    # Largest learned change of the delay, as a share of dead time plus lag; 0: none.
    timing_share: Annotated[float, Field(ge=0, le=1)]
    feedforward: FeedforwardSettings
    lqi: LqiSettings
    mpc: MpcSettings
    pure_pursuit: PurePursuitSettings
    stanley: StanleySettings


def build_law(settings: LateralSettings, vehicle: Vehicle) -> LateralLaw:
    """The law that ``settings`` names, for ``vehicle``. LQI is also the fallback of MPC."""
    delay_s = settings.command_delay_s
    match settings.law:
        case LawName.FEEDFORWARD:
            return Feedforward(settings.feedforward, vehicle)
        case LawName.LQI:
            return Lqi(settings.lqi, vehicle, command_delay_s=delay_s)
        case LawName.MPC:
            fallback = Lqi(settings.lqi, vehicle, command_delay_s=delay_s)
            return Mpc(settings.mpc, vehicle, command_delay_s=delay_s, fallback=fallback)
        case LawName.PURE_PURSUIT:
            return PurePursuit(settings.pure_pursuit)
        case LawName.STANLEY:
            return Stanley(settings.stanley, vehicle)
