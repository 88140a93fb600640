"""Settings of image disturbances: their kind, their grade from 0 (none) to 5 (worst), and their stretch of road.

``config/disturbances.yaml`` defines the grades in physical units.
"""

from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from sim_harness.world.roads.appearance import NeighbourLane, Section, Verge
from sim_harness.world.roads.disturbance_table import at, load_table
from sim_harness.world.roads.road import RoadSettings
from trepid.config import Settings

RAMP_M = 10.0  # over which the grade rises and falls
MAX_GRADE = 5.0


class DisturbanceKind(StrEnum):
    """Kinds of image disturbance: light, weather, lens, motion, sensor, codec, occlusion."""

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


PAINTED = {  # on the ground: a field of the section, and the quantity that is its minimum
    DisturbanceKind.TREE_SHADOWS: ("shadows", "share"),
    DisturbanceKind.BUILDING_SHADOWS: ("building_shadows", "share"),
    DisturbanceKind.BRIDGE_SHADOWS: ("bridge_shadows", "share"),
    DisturbanceKind.RAIN: ("wet", "wet"),
    DisturbanceKind.WET_ROAD: ("wet", "wet"),
    DisturbanceKind.SNOW: ("snow_cover", "cover"),
}


class Disturbance(Settings):
    """One disturbance on a stretch of road; ``tunnel_exit`` is a tunnel from ``from_m`` to ``to_m``."""

    kind: DisturbanceKind
    grade: Annotated[float, Field(ge=0, le=MAX_GRADE)]
    from_m: Annotated[float, Field(ge=0)] = 0.0  # station
    to_m: Annotated[float, Field(gt=0)] | None = None  # default: to the end of the road

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> Self:
        if self.to_m is not None and self.to_m <= self.from_m:
            raise ValueError(f"to_m must lie beyond from_m: {self.from_m:g} m, got {self.to_m:g} m")
        return self

    def grade_at(self, station_m: float) -> float:
        """The grade for a camera at a station: rises and falls over RAMP_M inside the stretch.

        There is no ramp at the start and at the end of the road.
        """
        rise = (station_m - self.from_m) / RAMP_M if self.from_m > 0 else 1.0
        fall = (self.to_m - station_m) / RAMP_M if self.to_m is not None else 1.0
        return self.grade * min(max(min(rise, fall), 0.0), 1.0)


def grades_at(disturbances: Sequence[Disturbance], station_m: float) -> dict[DisturbanceKind, float]:
    """The grade of each kind present at a station; of two of a kind, the higher."""
    grades: dict[DisturbanceKind, float] = {}
    for disturbance in disturbances:
        grade = disturbance.grade_at(station_m)
        if grade > grades.get(disturbance.kind, 0.0):
            grades[disturbance.kind] = grade
    return grades


def disturb(settings: RoadSettings, disturbances: Sequence[Disturbance]) -> RoadSettings:
    """``settings`` with the disturbances that are painted on the ground. Idempotent.

    A disturbance that begins or ends within a section splits it; both parts keep its name.
    """
    for disturbance in disturbances:
        if disturbance.kind in PAINTED and disturbance.grade > 0:
            settings = _repaint(settings, disturbance)
    return settings


def _repaint(settings: RoadSettings, disturbance: Disturbance) -> RoadSettings:
    length_m = sum(segment.length_m for segment in settings.segments)
    sections, from_m = _split(settings.sections, disturbance.from_m, length_m)
    sections, to_m = _split(sections, length_m if disturbance.to_m is None else disturbance.to_m, length_m)
    field, quantity = PAINTED[disturbance.kind]
    least = at(getattr(getattr(load_table(), disturbance.kind), quantity), disturbance.grade)
    verge = {"verge": Verge.SNOW} if disturbance.kind == DisturbanceKind.SNOW else {}  # it is covered first
    painted = tuple(
        section.model_copy(update={field: max(least, getattr(section, field)), **verge})
        if from_m <= section.start_m < to_m
        else section
        for section in sections
    )
    return settings.model_copy(update={"sections": painted})


def _split(
    sections: tuple[Section, ...], station_m: float, length_m: float
) -> tuple[tuple[Section, ...], float]:
    """The sections, cut at ``station_m`` or up to a dash before it, and the station of the cut.

    Dashes are counted from the start of a section: a cut after a whole number of them does not move them.
    """
    if not 0 < station_m < length_m:
        return sections, station_m
    index = bisect_right([section.start_m for section in sections], station_m)
    section = sections[index - 1]
    period_m = section.left.dash_m + section.left.gap_m
    cut_m = section.start_m + (station_m - section.start_m) // period_m * period_m
    if cut_m == section.start_m:
        return sections, cut_m
    end_m = sections[index].start_m if index < len(sections) else length_m
    share = (cut_m - section.start_m) / (end_m - section.start_m)
    before, after = (_part(section, share, half) for half in (0, 1))
    after = after.model_copy(update={"start_m": cut_m})
    return (*sections[: index - 1], before, after, *sections[index:]), cut_m


def _part(section: Section, share: float, half: int) -> Section:
    """The first (0) or second (1) part of a section that is cut at a share of its length."""

    def cut(width_m: float | tuple[float, float] | None) -> float | tuple[float, float] | None:
        if not isinstance(width_m, tuple):
            return width_m
        middle_m = width_m[0] + share * (width_m[1] - width_m[0])
        return (width_m[0], middle_m) if half == 0 else (middle_m, width_m[1])

    def lanes(found: tuple[NeighbourLane, ...]) -> tuple[NeighbourLane, ...]:
        return tuple(lane.model_copy(update={"width_m": cut(lane.width_m)}) for lane in found)

    widths = {"lane_width_m": cut(section.lane_width_m)}
    sides = {"left_lanes": lanes(section.left_lanes), "right_lanes": lanes(section.right_lanes)}
    return section.model_copy(update=widths | sides)
