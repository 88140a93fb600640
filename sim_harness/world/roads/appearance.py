"""Settings of a stretch of road: lanes, markings, surface, verge, light."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from trepid.config import Settings
from trepid.types import NonNegative, Positive, Share


class Paint(StrEnum):
    WHITE = "white"
    YELLOW = "yellow"
    BLUE = "blue"  # tape
    BLACK = "black"


class Stroke(StrEnum):
    """Pattern of a marking; of two parallel lines the left one is named first."""

    SOLID = "solid"
    DASHED = "dashed"
    NONE = "none"
    DOUBLE_SOLID = "double_solid"
    DOUBLE_DASHED = "double_dashed"
    SOLID_DASHED = "solid_dashed"
    DASHED_SOLID = "dashed_solid"


class Surface(StrEnum):
    ASPHALT = "asphalt"
    CONCRETE = "concrete"
    GRAVEL = "gravel"
    FLOOR = "floor"  # that of the verge: lines of tape on the floor of a room


class Verge(StrEnum):
    """Ground next to the carriageway."""

    GRASS = "grass"
    DRY_GRASS = "dry_grass"
    SOIL = "soil"
    SNOW = "snow"
    GRAVEL = "gravel"
    PAVEMENT = "pavement"  # slabs of a footway
    WATER = "water"  # below a bridge
    WOOD = "wood"  # floors of rooms: planks, ...
    MAT = "mat"  # ... dark rubber, ...
    LIGHT_FLOOR = "light_floor"  # ... pale tiles, ...
    CARPET = "carpet"  # ... grey loops


Width = Annotated[float, Field(ge=0, le=20)]
LaneWidth = Annotated[float, Field(ge=0.1, le=15.0)]  # below PUBLIC_LANE_M: the road of a model car
Stretch = tuple[NonNegative, NonNegative]  # from, to [m]: stations along the road


class Light(Settings):
    """Light, exposure and image quality of one frame."""

    gain: Positive = 1.0  # exposure relative to a well-exposed frame
    gamma: Positive = 1.0  # > 1 darkens the middle greys
    glare: Share = 0.0  # low sun ahead: 0 none, 1 blinding
    haze: Share = 0.0  # share of the contrast lost over the whole image
    noise: NonNegative = 2.0  # standard deviation of sensor noise [grey levels]
    blur_px: NonNegative = 0.0  # standard deviation of defocus


class Marking(Settings):
    """One painted line, or a pair of lines around its place."""

    stroke: Stroke = Stroke.SOLID
    paint: Paint = Paint.WHITE
    width_m: Annotated[float, Field(gt=0, le=0.5)] = 0.12  # 0.10 to 0.15 in most countries (RMS, MUTCD 3A)
    dash_m: Positive = 3.0
    gap_m: NonNegative = 6.0  # 3 m dash, 6 m gap: rural roads (German RMS-1)
    wear: Share = 0.0  # share of the paint worn off, in soft patches
    damage: Share = 0.0  # share of the line that is cut out or crossed by cracks, with hard edges
    gaps_m: tuple[Stretch, ...] = ()  # interruptions of the line
    spacing_m: Positive = 0.12  # clear distance within a pair (RMS-1, MUTCD 3A: one line's width)

    @model_validator(mode="after")
    def _gaps_run_forwards(self) -> Self:
        for start_m, end_m in self.gaps_m:
            if start_m >= end_m:
                raise ValueError(f"a gap must end beyond its start, got [{start_m}, {end_m}]")
        return self


class NeighbourLane(Settings):
    """A lane parallel to the ego lane."""

    # Constant, or (at the start, at the end); None: that of the kept lane.
    width_m: Width | tuple[Width, Width] | None = None
    marking: Marking = Marking(stroke=Stroke.NONE)  # on its far edge


class Section(Settings):
    """Appearance of the road from ``start_m`` to the start of the next section."""

    name: str
    start_m: NonNegative
    left: Marking = Marking(stroke=Stroke.DASHED)  # on the left edge of the lane
    right: Marking = Marking()  # on the right edge of the lane
    middle: Marking = Marking(
        stroke=Stroke.NONE
    )  # in the middle of the lane: a single line that a car follows
    far_left: Marking = Marking(stroke=Stroke.NONE)  # of one left lane, which lies on paved_left_m
    # Constant, or (at the start, at the end); None: that of the road.
    lane_width_m: LaneWidth | tuple[LaneWidth, LaneWidth] | None = None
    left_lanes: tuple[NeighbourLane, ...] = ()  # from the kept lane outwards
    right_lanes: tuple[NeighbourLane, ...] = ()
    paved_left_m: NonNegative = 0.3  # carriageway beyond the left edge of the lane and of its left_lanes
    paved_right_m: NonNegative = 0.3
    edge_roughness_m: NonNegative = 0.03  # standard deviation of the edge of the carriageway
    edge_breaks: Share = 0.0  # share of the edge with pieces broken off, up to 0.6 m deep
    kerb_m: Annotated[float, Field(ge=0, le=1)] = 0.0  # pale kerb or parapet along both edges, drawn flat
    surface: Surface = Surface.ASPHALT
    surface_grey: Share = 0.45  # mean grey of the carriageway in a well-exposed frame
    patchiness: Share = 0.3  # repairs, cracks, tar seams
    seams_m: tuple[float, ...] = ()  # places of tar seams along the road, + left of the middle of the lane
    verge: Verge = Verge.GRASS
    snow_left_m: NonNegative = 0.0  # width of a ragged bank of snow on the edge of the carriageway
    snow_right_m: NonNegative = 0.0
    snow_cover: Share = 0.0  # share of the carriageway, with its markings, under trodden snow
    wet: Share = 0.0  # 0 dry, 1 soaked: darker, smoother, with puddles
    shadows: Share = 0.0  # tree shadows across the road: 0 none, 1 dense
    building_shadows: Share = 0.0  # of houses on the right: 0 none, 1 across the whole road
    bridge_shadows: Share = 0.0  # bands across the road, one about every 50 m: 0 none, 1 wide and dark
    window_light: Share = 0.0  # patches of sun through windows on the ground: 0 none, 1 as light as paint
    light: Light = Light()

    @model_validator(mode="after")
    def _the_left_lane_is_given_once(self) -> Self:
        if self.left_lanes and self.far_left.stroke != Stroke.NONE:
            raise ValueError("far_left describes one left lane; with left_lanes, put its marking there")
        return self

    @property
    def lanes_to_the_left(self) -> tuple[NeighbourLane, ...]:
        """``left_lanes``, or the one lane of ``far_left``."""
        if self.left_lanes or self.far_left.stroke == Stroke.NONE:
            return self.left_lanes
        return (NeighbourLane(marking=self.far_left),)

    def lane_width_m_at_ends(self, lane: int, default_m: float) -> tuple[float, float] | None:
        """Width of a lane at the start and at the end: 0 is the kept lane, 1 left of it, -1 right of it.

        ``default_m`` is the road's lane width. None where there is no such lane.
        """
        kept = _ends(self.lane_width_m, (default_m, default_m))
        if lane == 0:
            return kept
        lanes = self.lanes_to_the_left if lane > 0 else self.right_lanes
        return _ends(lanes[abs(lane) - 1].width_m, kept) if abs(lane) <= len(lanes) else None


def _ends(width_m: Width | tuple[Width, Width] | None, default_m: tuple[float, float]) -> tuple[float, float]:
    if width_m is None:
        return default_m
    return width_m if isinstance(width_m, tuple) else (width_m, width_m)
