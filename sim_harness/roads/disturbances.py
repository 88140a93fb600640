"""What spoils a camera's picture: kinds of disturbance, graded 0 (none) to 5 (worst), by place. Pure settings.

What each grade means in physical units stands in ``config/disturbances.yaml``.
"""

from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sim_harness.roads.appearance import Section
from sim_harness.roads.road import RoadSettings
from trepid.config import Settings

RAMP_M = 10.0  # over which a disturbance comes and goes
MAX_GRADE = 5.0


class DisturbanceKind(StrEnum):
    """What spoils the picture."""

    NIGHT = "night"
    LOW_SUN = "low_sun"
    GLARE = "glare"
    OVER_EXPOSURE = "over_exposure"
    TUNNEL_EXIT = "tunnel_exit"
    TREE_SHADOWS = "tree_shadows"
    BUILDING_SHADOWS = "building_shadows"
    BRIDGE_SHADOWS = "bridge_shadows"
    RAIN = "rain"
    WET_ROAD = "wet_road"
    SNOW = "snow"
    FOG = "fog"
    DIRT = "dirt"
    MOTION_BLUR = "motion_blur"
    ROLLING_SHUTTER = "rolling_shutter"
    NOISE = "noise"
    JPEG = "jpeg"
    OCCLUSION = "occlusion"


class Disturbance(Settings):
    """One disturbance of a stretch of road; ``tunnel_exit`` is a tunnel from ``from_m`` to ``to_m``."""

    kind: DisturbanceKind
    grade: Annotated[float, Field(ge=0, le=MAX_GRADE)]
    from_m: Annotated[float, Field(ge=0)] = 0.0  # station
    to_m: Annotated[float, Field(gt=0)] | None = None  # without: to the end

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> Self:
        if self.to_m is not None and self.to_m <= self.from_m:
            raise ValueError(f"to_m must lie beyond from_m: {self.from_m:g} m, got {self.to_m:g} m")
        return self

    def grade_at(self, station_m: float) -> float:
        """The grade for a camera at a station: rises and falls over RAMP_M inside the stretch.

        From the very start of the road, and to its very end, there is no ramp.
        """
        rise = (station_m - self.from_m) / RAMP_M if self.from_m > 0 else 1.0
        fall = (self.to_m - station_m) / RAMP_M if self.to_m is not None else 1.0
        return self.grade * min(max(min(rise, fall), 0.0), 1.0)


def grades_at(disturbances: Sequence[Disturbance], station_m: float) -> dict[DisturbanceKind, float]:
    """The grade of each kind that there is at a station; of two of a kind, the higher."""
    grades: dict[DisturbanceKind, float] = {}
    for disturbance in disturbances:
        grade = disturbance.grade_at(station_m)
        if grade > grades.get(disturbance.kind, 0.0):
            grades[disturbance.kind] = grade
    return grades


PAINTED = {
    DisturbanceKind.TREE_SHADOWS: "shadows",
    DisturbanceKind.BUILDING_SHADOWS: "building_shadows",
    DisturbanceKind.BRIDGE_SHADOWS: "bridge_shadows",
    DisturbanceKind.WET_ROAD: "wet",
    DisturbanceKind.RAIN: "wet",
}
"""Disturbances that lie on the ground, and the field of a section that holds their share."""


def disturbed(settings: RoadSettings, disturbances: Sequence[Disturbance]) -> RoadSettings:
    """``settings`` with the disturbances that are painted on the ground; done twice it is as done once.

    A disturbance that begins or ends within a section parts it; both parts keep its name.
    """
    for disturbance in disturbances:
        field = PAINTED.get(disturbance.kind)
        if field is not None and disturbance.grade > 0:
            settings = _painted(settings, field, disturbance)
    return settings


def _painted(settings: RoadSettings, field: str, disturbance: Disturbance) -> RoadSettings:
    length_m = sum(segment.length_m for segment in settings.segments)
    from_m, to_m = disturbance.from_m, min(disturbance.to_m or length_m, length_m)
    sections = _parted(_parted(settings.sections, from_m, length_m), to_m, length_m)
    share = disturbance.grade / MAX_GRADE
    painted = tuple(
        section.model_copy(update={field: max(share, getattr(section, field))})
        if from_m <= section.start_m < to_m
        else section
        for section in sections
    )
    return settings.model_copy(update={"sections": painted})


def _parted(sections: tuple[Section, ...], station_m: float, length_m: float) -> tuple[Section, ...]:
    """The sections with one that starts at ``station_m``."""
    starts = [section.start_m for section in sections]
    if station_m in starts or not 0 < station_m < length_m:
        return sections
    index = bisect_right(starts, station_m)
    part = sections[index - 1].model_copy(update={"start_m": station_m})
    return (*sections[:index], part, *sections[index:])
