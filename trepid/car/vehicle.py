"""Dimensions, steering and limits of a vehicle: ``config/vehicle.yaml``."""

import math
from enum import StrEnum
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from trepid.config import Settings, wrong_at
from trepid.scale import REFERENCE_LANE_M, scaled_settings
from trepid.types import NonNegative, Positive

GRADIENT = "understeer_gradient_rad_per_mps2"
REAR_SLIP = "rear_slip_gradient_rad_per_mps2"
ALONG_THE_MIDDLE = "along the middle of the road (corridor: road)"
LEAST_ROAD = 1.2  # lane widths, of a road whose middle is not that of a lane


def road_wheel_angle(curvature_1pm: float, *, wheelbase_m: float) -> float:
    """Road-wheel angle [rad], + left, that drives ``curvature_1pm`` without slip: δ = atan(L·κ).

    Rajamani, Vehicle Dynamics and Control (2012), section 2.2. The controller adds understeer.
    """
    return math.atan(wheelbase_m * curvature_1pm)


def understeer_gradient(
    *,
    mass_kg: float,
    wheelbase_m: float,
    cg_to_front_m: float,
    front_stiffness_nprad: float,
    rear_stiffness_nprad: float,
) -> float:
    """K_us = m_f/C_f - m_r/C_r [rad/(m/s²)] from the masses on the axles and their cornering stiffnesses [N/rad].

    With m_f = m·l_r/L and m_r = m·l_f/L. The slip factor of opendbc is s = -K_us/L [s²/m²]: κ = δ/(L·(1 - s·v²)).

    Rajamani, Vehicle Dynamics and Control (2012), section 3.3.
    """
    rear_kg = mass_kg * cg_to_front_m / wheelbase_m
    return (mass_kg - rear_kg) / front_stiffness_nprad - rear_kg / rear_stiffness_nprad


class Traffic(StrEnum):
    """The side of the road on which vehicles drive."""

    LEFT = "left"
    RIGHT = "right"
    UNKNOWN = "unknown"


class Corridor(StrEnum):
    """What the car drives in the middle of."""

    LANE = "lane"  # its lane
    ROAD = "road"  # the road, between its outer lines or edges: closed paths of a single vehicle


class Side(StrEnum):
    """A side of the car."""

    LEFT = "left"
    RIGHT = "right"


class Chassis(Settings):
    """Mass and tyres, for a vehicle whose understeer gradient is not measured."""

    mass_kg: Positive
    cg_to_front_m: Positive  # centre of gravity to front axle
    front_stiffness_nprad: Positive  # cornering stiffness of both tyres of the axle
    rear_stiffness_nprad: Positive


def _gradient(data: dict[str, Any]) -> float:
    """K_us from the chassis; NaN where there is none."""
    chassis: Chassis | None = data["chassis"]
    if chassis is None:
        return math.nan
    return understeer_gradient(wheelbase_m=data["wheelbase_m"], **chassis.model_dump())


def _rear_slip(data: dict[str, Any]) -> float:
    """R = m_r/C_r from the chassis; 0 where there is none."""
    chassis: Chassis | None = data["chassis"]
    if chassis is None:
        return 0.0
    rear_kg = chassis.mass_kg * chassis.cg_to_front_m / data["wheelbase_m"]
    return rear_kg / chassis.rear_stiffness_nprad


class Vehicle(Settings):
    """A car-like vehicle; the reference point is the centre of the rear axle."""

    name: str
    wheelbase_m: Positive
    track_m: Positive  # between the outer edges of the wheels
    front_overhang_m: NonNegative  # front axle to bumper
    rear_overhang_m: NonNegative
    steering_ratio: Positive  # steering-wheel angle / road-wheel angle
    # side of positive steering in logs of this car; None: by their format. Nothing drives by it: no part of dumps
    logged_positive: Annotated[Side | None, Field(exclude=True)] = None
    max_road_wheel_angle_rad: Annotated[float, Field(gt=0, lt=1.2)]
    max_road_wheel_rate_radps: Positive
    steering_delay_s: NonNegative  # dead time of the steering actuator
    steering_lag_s: NonNegative  # first-order time constant of the steering actuator
    # alternative to the next two; excluded from dumps
    chassis: Chassis | None = Field(default=None, exclude=True)
    # K_us in δ = atan(L·κ) + K_us·κ·v²
    understeer_gradient_rad_per_mps2: float = Field(default_factory=_gradient)
    # R: in a bend the course of the rear axle lies R·κ·v² outside of the heading; 0: not known, or rigid tyres
    rear_slip_gradient_rad_per_mps2: NonNegative = Field(default_factory=_rear_slip)
    max_accel_mps2: Positive
    max_decel_mps2: Positive  # of the brakes
    accel_lag_s: NonNegative  # first-order time constant of drive and brakes
    standstill_mps: Positive  # below this speed it stands
    lane_width_m: Annotated[float, Field(ge=0.1, le=6)] = REFERENCE_LANE_M  # usual, of the lanes it drives in
    traffic: Traffic = Traffic.UNKNOWN  # learned while driving where it is not given
    dash_period_m: Positive | None = None  # from dash to dash of the lines of its lanes; None: not known
    corridor: Corridor = Corridor.LANE
    road_width_m: Positive | None = None  # of corridor: road, between the outer lines or edges

    @property
    def scale(self) -> float:
        """Its world relative to the reference world of :mod:`trepid.scale`; 1 on lanes of 3.3 m."""
        return self.lane_width_m / REFERENCE_LANE_M

    def possible_1pm(self, most_1pm: float) -> float:
        """Limit of the curvature of a lane that is believed [1/m]: ``most_1pm``, or 1.4 times its tightest turn.

        A corner of tape is tighter than the way of a car through it. Without slip the car turns by tan δ/L.
        """
        return max(1.4 * math.tan(self.max_road_wheel_angle_rad) / self.wheelbase_m, most_1pm)

    @property
    def in_reference_world(self) -> "Vehicle":
        """The vehicle enlarged to the reference world; itself at a scale of 1."""
        return scaled_settings(self, 1 / self.scale)

    @model_validator(mode="after")
    def _one_corridor(self) -> Self:
        if self.corridor is Corridor.LANE:
            if self.road_width_m is not None:
                raise wrong_at(("road_width_m",), "only corridor: road reads it: set that, or leave it out")
        elif self.road_width_m is None:
            raise wrong_at(
                ("corridor",), "road needs road_width_m, between the outer lines or edges of the road"
            )
        elif self.road_width_m < LEAST_ROAD * self.lane_width_m:
            what = f"a road with a middle of its own is at least {LEAST_ROAD:g} lane_width_m wide"
            raise wrong_at(("road_width_m",), what)
        elif self.traffic is not Traffic.UNKNOWN:
            what = "traffic keeps to a side, and corridor: road drives on the middle: leave out one of them"
            raise wrong_at(("traffic",), what)
        return self

    @model_validator(mode="after")
    def _one_understeer(self) -> Self:
        if self.chassis is None:
            if math.isnan(self.understeer_gradient_rad_per_mps2):
                raise wrong_at((), f"{GRADIENT!r} is missing; 'chassis' would do instead")
        elif given := {GRADIENT, REAR_SLIP} & self.model_fields_set:
            what = "the understeer" if GRADIENT in given else "the slip of the rear axle"
            raise wrong_at(("chassis",), f"gives {what}, and so does {max(given)!r}: leave one out")
        elif self.chassis.cg_to_front_m >= self.wheelbase_m:
            raise wrong_at(("chassis", "cg_to_front_m"), "the centre of gravity must lie between the axles")
        return self
