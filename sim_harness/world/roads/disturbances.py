"""Settings of image disturbances: their kind, their grade from 0 (none) to 5 (worst), and their stretch of road.

``config/disturbances.yaml`` defines the grades in physical units.
"""

from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from sim_harness.world.roads.appearance import Section, Verge
from sim_harness.world.roads.disturbance_table import Grades, at, load_table
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


def disturbed(settings: RoadSettings, disturbances: Sequence[Disturbance]) -> RoadSettings:
    """``settings`` with the disturbances that are painted on the ground. Idempotent.

    A disturbance that begins or ends within a section splits it; both parts keep its name.
    """
    for disturbance in disturbances:
        changes = _painted(disturbance.kind, disturbance.grade)
        if changes and disturbance.grade > 0:
            settings = _repainted(settings, disturbance, changes)
    return settings


def _painted(kind: DisturbanceKind, grade: float) -> dict[str, float]:
    """Fields of a section and their minimum under a disturbance; empty for disturbances of air or camera."""
    table = load_table()
    fields: dict[DisturbanceKind, tuple[str, Grades]] = {
        DisturbanceKind.TREE_SHADOWS: ("shadows", table.tree_shadows.share),
        DisturbanceKind.BUILDING_SHADOWS: ("building_shadows", table.building_shadows.share),
        DisturbanceKind.BRIDGE_SHADOWS: ("bridge_shadows", table.bridge_shadows.share),
        DisturbanceKind.RAIN: ("wet", table.rain.wet),
        DisturbanceKind.WET_ROAD: ("wet", table.wet_road.wet),
        DisturbanceKind.SNOW: ("snow_cover", table.snow.cover),
    }
    if kind not in fields:
        return {}
    name, grades = fields[kind]
    return {name: at(grades, grade)}


def _repainted(settings: RoadSettings, disturbance: Disturbance, changes: dict[str, float]) -> RoadSettings:
    length_m = sum(segment.length_m for segment in settings.segments)
    sections, from_m = _split(settings.sections, disturbance.from_m, length_m)
    sections, to_m = _split(sections, length_m if disturbance.to_m is None else disturbance.to_m, length_m)
    painted = tuple(
        _covered(section, disturbance.kind, changes) if from_m <= section.start_m < to_m else section
        for section in sections
    )
    return settings.model_copy(update={"sections": painted})


def _covered(section: Section, kind: DisturbanceKind, changes: dict[str, float]) -> Section:
    update: dict[str, object] = {name: max(value, getattr(section, name)) for name, value in changes.items()}
    if kind == DisturbanceKind.SNOW:
        update["verge"] = Verge.SNOW  # snow covers the verge first
    return section.model_copy(update=update)


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
    before, after = (
        section.model_copy(
            update={
                "lane_width_m": _cut(section.lane_width_m, share, half),
                **{
                    name: tuple(
                        lane.model_copy(update={"width_m": _cut(lane.width_m, share, half)})
                        for lane in getattr(section, name)
                    )
                    for name in ("left_lanes", "right_lanes")
                },
            }
        )
        for half in (0, 1)
    )
    return (
        *sections[: index - 1],
        before,
        after.model_copy(update={"start_m": cut_m}),
        *sections[index:],
    ), cut_m


def _cut(
    width_m: float | tuple[float, float] | None, share: float, half: int
) -> float | tuple[float, float] | None:
    """The width of the first (0) or second (1) part of a section that is cut at a share of its length."""
    if not isinstance(width_m, tuple):
        return width_m
    middle_m = width_m[0] + share * (width_m[1] - width_m[0])
    return (width_m[0], middle_m) if half == 0 else (middle_m, width_m[1])
