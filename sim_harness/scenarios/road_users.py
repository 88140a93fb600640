"""Settings of people, cyclists and animals: their start, and the phases in which they move.

A road user moves at constant speed, or stands, until a phase changes that. The trigger of a phase is a time, a
gap or the end of the phase before. Road users do not react to the car, as the worst of them do not.
"""

import math
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sim_harness.scenarios.traffic import PlaceOnRoad
from sim_harness.world.render.scene.people import FIGURES, Figure, Shape
from trepid.config import Settings
from trepid.types import NonNegative, Positive

START_RATE_MPS2 = 1.0
"""A walker reaches 5 km/h within 1.0 m, a runner 8 km/h within 1.5 m (Euro NCAP AEB VRU): 1.0 and 1.6 m/s²."""


class UserSensor(StrEnum):
    """Source of the road users ahead."""

    CAMERA = "camera"  # the detector, from rendered images
    TRUTH = "truth"  # their exact places, where a line of sight reaches them
    MODELLED = "modelled"  # likewise, with the errors of a detector, see config/road_user_model.yaml


class UserTrigger(Settings):
    """Start of a phase: exactly one of these fields. Phases begin in the order of the list."""

    at_s: NonNegative | None = None  # of the run
    at_gap_m: float | None = None  # at most this far ahead of the ego bumper
    after_s: NonNegative | None = None  # the end of the phase before, or the start of the run

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if [self.at_s, self.at_gap_m, self.after_s].count(None) != 2:
            raise ValueError("give one of at_s, at_gap_m, after_s")
        return self


class Cross(UserTrigger):
    """Moves on a straight line to another offset, then along the road at `then_mps`, or stands.

    From a standstill, over a distance d ≥ v²/2a, it takes d/v + v/2a.
    """

    kind: Literal["cross"]
    to_lane: int = 0  # 0: the ego lane, 1: the next to the left
    to_offset_m: float = 0.0  # from the centre of that lane, + = left
    speed_mps: Positive
    lean_rad: Annotated[float, Field(gt=-math.pi / 2, lt=math.pi / 2)] = 0.0  # + = forwards along the road
    rate_mps2: Positive = START_RATE_MPS2
    then_mps: NonNegative = 0.0


class ChangePace(UserTrigger):
    """Reaches another speed at a constant rate, in the direction of its motion; 0: it stands."""

    kind: Literal["change_pace"]
    to_mps: NonNegative
    rate_mps2: Positive = START_RATE_MPS2


UserPhase = Annotated[Cross | ChangePace, Field(discriminator="kind")]


class RoadUser(PlaceOnRoad):
    """One person, cyclist or animal: the place and speed at t = 0, and the phases."""

    speed_mps: NonNegative = 0.0  # in the direction that it faces; 0: stands
    facing_rad: Annotated[float, Field(ge=-math.pi, le=math.pi)] = (
        0.0  # relative to the road; π/2: to the left
    )
    shape: Shape = Shape.ADULT
    phases: tuple[UserPhase, ...] = ()

    @property
    def figure(self) -> Figure:
        """Size and looks."""
        return FIGURES[self.shape]
