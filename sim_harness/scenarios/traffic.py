"""Settings of other vehicles: their start, and the phases in which they change speed or lane.

A vehicle drives along the road at constant speed and offset until a phase changes them. The trigger of a phase is a
time, a station or a gap; vehicles do not react to anything else.
"""

import math
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sim_harness.world.render.scene.vehicles import Body
from trepid.config import Settings
from trepid.types import NonNegative, Positive


class Shape(StrEnum):
    """Size class of a vehicle."""

    CAR = "car"
    VAN = "van"
    TRUCK = "truck"


BODIES = {
    Shape.CAR: Body(),
    Shape.VAN: Body(rear_m=-1.05, front_m=4.25, width_m=2.0, height_m=2.4, waist_m=1.25, bgr=(215, 215, 210)),
    Shape.TRUCK: Body(
        rear_m=-2.6, front_m=5.9, width_m=2.5, height_m=3.5, waist_m=2.0, clearance_m=0.45, bgr=(70, 90, 150)
    ),
}
"""Sizes as of a compact car, a Ford Transit L3H2, and a 12 t box truck (EU maximum width 2.55 m, 96/53/EC)."""


class Trigger(Settings):
    """Start of a phase: exactly one of these fields. Phases begin in the order of the list."""

    at_s: NonNegative | None = None  # of the run
    at_station_m: float | None = None  # of its rear axle
    at_gap_m: float | None = None  # between the bumpers, while the vehicle is ahead

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if [self.at_s, self.at_station_m, self.at_gap_m].count(None) != 2:
            raise ValueError("give one of at_s, at_station_m, at_gap_m")
        return self


class ChangeSpeed(Trigger):
    """Accelerates or brakes to a speed at a constant rate."""

    kind: Literal["change_speed"]
    to_mps: NonNegative
    rate_mps2: Positive = 2.0


class ChangeLane(Trigger):
    """Moves to another offset within `over_s`, with minimum jerk: o(τ) = o₀ + Δo·(10τ³ - 15τ⁴ + 6τ⁵).

    Flash and Hogan, The coordination of arm movements (1985). Naturalistic lane changes last 3 to 8 s.
    """

    kind: Literal["change_lane"]
    to_lane: int = 0  # 0: the ego lane, 1: the next to the left
    to_offset_m: float = 0.0  # from the centre of that lane, + = left
    over_s: Positive = 4.0


class TurnOff(Trigger):
    """Leaves the road on an arc through `angle_rad`, then continues straight."""

    kind: Literal["turn_off"]
    side: Literal["left", "right"]
    radius_m: Positive = 10.0
    angle_rad: Annotated[float, Field(gt=0, le=math.pi)] = math.pi / 2


Phase = Annotated[ChangeSpeed | ChangeLane | TurnOff, Field(discriminator="kind")]


class PlaceOnRoad(Settings):
    """The place of a vehicle, person or animal at t = 0: ahead of the ego vehicle, or at a station."""

    gap_m: float | None = (
        None  # from the ego bumper: to the near bumper of a vehicle, to the middle of others
    )
    station_m: float | None = None  # of the rear axle of a vehicle, of the middle of others; instead of gap_m
    lane: int = 0  # 0: the ego lane, 1: the next to the left, -1: to the right
    offset_m: float = 0.0  # from the centre of that lane, + = left

    @model_validator(mode="after")
    def _has_one_place(self) -> Self:
        if (self.gap_m is None) == (self.station_m is None):
            raise ValueError("give one of gap_m, station_m")
        return self


class TrafficVehicle(PlaceOnRoad):
    """One other vehicle: its place and speed at t = 0, and its phases."""

    speed_mps: NonNegative = 0.0  # 0: parked
    oncoming: bool = False
    shape: Shape = Shape.CAR
    phases: tuple[Phase, ...] = ()

    @property
    def body(self) -> Body:
        """Size and colour."""
        return BODIES[self.shape]
