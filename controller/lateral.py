"""Which law steers: ``lateral`` in ``config/controller.yaml``."""

from enum import StrEnum

from controller.lateral_feedforward import Feedforward, FeedforwardSettings
from controller.law import LateralLaw
from trepid.config import Settings
from trepid.vehicle import NonNegative, Vehicle


class LawName(StrEnum):
    """The lateral laws."""

    FEEDFORWARD = "feedforward"


class LateralSettings(Settings):
    """``lateral`` in ``config/controller.yaml``: the law that steers, and a section for each."""

    law: LawName
    command_delay_s: NonNegative  # from the controller to the actuator, mean hold of the command included
    feedforward: FeedforwardSettings


def build_law(settings: LateralSettings, vehicle: Vehicle) -> LateralLaw:
    """The law that ``settings`` names, for ``vehicle`` as it is believed to be."""
    match settings.law:
        case LawName.FEEDFORWARD:
            return Feedforward(settings.feedforward, vehicle)
