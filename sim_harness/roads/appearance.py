"""What a stretch of road looks like: markings, surface and verge. Pure settings, no geometry."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from sim_harness.roads.light import Light, NonNegative, Positive, Share
from trepid.config import Settings


class Paint(StrEnum):
    """Colour of a marking."""

    WHITE = "white"
    YELLOW = "yellow"


class Stroke(StrEnum):
    """Pattern of a marking."""

    SOLID = "solid"
    DASHED = "dashed"
    NONE = "none"


class Surface(StrEnum):
    """What the carriageway is made of."""

    ASPHALT = "asphalt"
    CONCRETE = "concrete"
    GRAVEL = "gravel"


class Verge(StrEnum):
    """What lies beside the carriageway."""

    GRASS = "grass"
    DRY_GRASS = "dry_grass"
    SOIL = "soil"
    SNOW = "snow"


class Marking(Settings):
    """One painted line, centred on its place."""

    stroke: Stroke = Stroke.SOLID
    paint: Paint = Paint.WHITE
    width_m: Annotated[float, Field(gt=0, le=0.5)] = 0.12  # 0.10 to 0.15 in most countries (RMS, MUTCD 3A)
    dash_m: Positive = 3.0
    gap_m: NonNegative = 6.0  # 3 m dash, 6 m gap: rural roads (German RMS-1)
    wear: Share = 0.0  # share of the paint that is gone


class Section(Settings):
    """Appearance of the road from ``start_m`` to the start of the next section."""

    name: str
    start_m: NonNegative
    left: Marking = Marking(stroke=Stroke.DASHED)  # on the left edge of the lane
    right: Marking = Marking()  # on the right edge of the lane
    far_left: Marking = Marking(stroke=Stroke.NONE)  # one lane width further left: edge of a neighbour lane
    paved_left_m: NonNegative = 0.3  # carriageway beyond the left edge of the lane
    paved_right_m: NonNegative = 0.3
    edge_roughness_m: NonNegative = 0.03  # standard deviation of the edge of the carriageway
    surface: Surface = Surface.ASPHALT
    surface_grey: Share = 0.45  # mean grey of the carriageway in a well-exposed frame
    patchiness: Share = 0.3  # repairs, cracks, tar seams
    verge: Verge = Verge.GRASS
    shadows: Share = 0.0  # tree shadows across the road: 0 none, 1 dense
    light: Light = Light()
