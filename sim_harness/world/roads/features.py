"""Settings of local features of a road: marks, speed humps, side roads that join it, walls along it."""

import math
from enum import StrEnum
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sim_harness.world.roads.appearance import Paint, Surface
from trepid.config import Settings
from trepid.types import Array, NonNegative, Positive, Share


class MarkKind(StrEnum):
    ARROW_STRAIGHT = "arrow_straight"
    ARROW_LEFT = "arrow_left"
    ARROW_RIGHT = "arrow_right"
    ARROW_STRAIGHT_LEFT = "arrow_straight_left"
    ARROW_STRAIGHT_RIGHT = "arrow_straight_right"
    TEXT = "text"
    ZEBRA = "zebra"
    STOP_LINE = "stop_line"


# Lengths along the road: RMS-1 (arrows 5 m, crossings at least 4 m, stop lines 0.5 m), letters as in MUTCD 3B.20.
LENGTH_M = {MarkKind.TEXT: 2.4, MarkKind.ZEBRA: 4.0, MarkKind.STOP_LINE: 0.5}
ARROW_M = 5.0


class RoadMark(Settings):
    """A mark on the carriageway, from station ``at_m`` on."""

    kind: MarkKind
    at_m: NonNegative
    lane: Annotated[int, Field(ge=-8, le=8)] = 0  # 0 the kept lane, 1 left of it, -1 right; zebra: all
    text: Annotated[str, Field(max_length=12, pattern=r"^[ -~]*$")] = ""
    length_m: Positive | None = None  # along the road; default by kind
    oncoming: bool = False  # rotated, for oncoming traffic
    paint: Paint = Paint.WHITE
    wear: Share = 0.0

    @model_validator(mode="after")
    def _text_has_letters(self) -> Self:
        if (self.kind == MarkKind.TEXT) != bool(self.text.strip()):
            raise ValueError("text is required for a mark of kind text and not allowed for any other kind")
        return self

    @property
    def extent_m(self) -> float:
        """Length along the road."""
        return LENGTH_M.get(self.kind, ARROW_M) if self.length_m is None else self.length_m

    @property
    def end_m(self) -> float:
        return self.at_m + self.extent_m


class JunctionKind(StrEnum):
    """Effect of a side road on the markings."""

    DRIVEWAY = "driveway"  # interrupts the edge line of its side
    INTERSECTION = "intersection"  # interrupts every line


class MouthLine(StrEnum):
    """Line across the half of a side road that leads to the main road."""

    NONE = "none"
    STOP = "stop"
    GIVE_WAY = "give_way"  # short dashes


class Side(StrEnum):
    LEFT = "left"
    RIGHT = "right"
    BOTH = "both"


class Junction(Settings):
    """A side road at right angles, its axis at station ``at_m``."""

    kind: JunctionKind
    side: Side
    at_m: NonNegative
    width_m: Annotated[float, Field(ge=2, le=20)] = 5.0
    radius_m: Annotated[float, Field(ge=0, le=15)] = 3.0  # of the rounded corners
    length_m: Annotated[float, Field(gt=0, le=80)] = 30.0  # from the edge of the carriageway
    surface: Surface | None = None  # None: that of the road
    centre_line: bool = False  # a dashed white line along its axis
    mouth_line: MouthLine | None = None  # None: a stop line with a centre line, none without
    rim_line: bool = False  # a white edge line around its corners
    kerb_m: Annotated[float, Field(ge=0, le=1)] = 0.0  # pale kerb around its corners
    left_hand: bool = False  # traffic keeps left: the line at its mouth spans the other half

    @property
    def line(self) -> MouthLine:
        """The line at its mouth."""
        usual = MouthLine.STOP if self.centre_line else MouthLine.NONE
        return usual if self.mouth_line is None else self.mouth_line

    @property
    def mouth_m(self) -> tuple[float, float]:
        """Stations between which the edge of the road is open."""
        half_m = self.width_m / 2 + self.radius_m
        return self.at_m - half_m, self.at_m + half_m


HUMP_SLOPE_MAX = 0.12  # height per length on the flank; those of 10 cm on 3.7 m have 0.085


class SpeedHump(Settings):
    """A speed hump across the road. It turns a vehicle that drives over it; its shape is not drawn.

    At the distance d beyond its start the hump is H·sin²(π·d/L) high. The default is as long and as high as the
    round-topped hump of Watts, Road humps for the control of vehicle speeds (TRRL report LR 597, 1973).
    """

    at_m: NonNegative  # station of its start
    length_m: Positive = 3.7
    height_m: Positive = 0.1

    @model_validator(mode="after")
    def _can_be_driven_over(self) -> Self:
        slope = math.pi * self.height_m / self.length_m
        if slope > HUMP_SLOPE_MAX:
            raise ValueError(f"its flanks have a slope of {slope:.2f}, and {HUMP_SLOPE_MAX:g} is the most")
        return self

    @property
    def end_m(self) -> float:
        """The station of its end."""
        return self.at_m + self.length_m

    def height_at(self, beyond_m: float) -> float:
        """Height [m] at this distance beyond its start; 0 outside."""
        if not 0.0 < beyond_m < self.length_m:
            return 0.0
        return self.height_m * math.sin(math.pi * beyond_m / self.length_m) ** 2


class WallKind(StrEnum):
    """What a wall looks like."""

    PARAPET = "parapet"  # pale concrete
    STONE = "stone"  # a garden wall
    HEDGE = "hedge"
    HOUSES = "houses"  # a row of fronts with windows
    KERB = "kerb"  # kerbstones that stand above the carriageway
    SNOW = "snow"  # the bank that a plough leaves
    TREES = "trees"  # a row of trunks with crowns, and gaps between them


HEIGHT_M = {
    WallKind.PARAPET: 1.1,
    WallKind.STONE: 2.0,
    WallKind.HEDGE: 2.2,
    WallKind.HOUSES: 7.0,
    WallKind.KERB: 0.12,
    WallKind.SNOW: 0.9,
    WallKind.TREES: 9.0,
}
"""Usual heights; a parapet is at least 1.0 m high (EN 1317-6)."""
TREE_EVERY_M, TRUNK_M = 8.0, 0.4  # from trunk to trunk; its width


class Wall(Settings):
    """A wall along the road, which hides what lies behind it."""

    kind: WallKind = WallKind.STONE
    side: Side
    from_m: NonNegative  # station
    to_m: Positive
    distance_m: NonNegative = 1.0  # from the edge of the kept lane to its near face
    height_m: Annotated[float, Field(gt=0, le=30)] | None = None  # above the ground; default by kind

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> Self:
        if self.to_m <= self.from_m:
            raise ValueError(f"a wall must end beyond its start, got {self.from_m:g} to {self.to_m:g} m")
        return self

    @property
    def tall_m(self) -> float:
        """Height above the ground."""
        return HEIGHT_M[self.kind] if self.height_m is None else self.height_m

    @property
    def signs(self) -> tuple[int, ...]:
        """The sides on which it stands: 1 left, -1 right."""
        return {Side.LEFT: (1,), Side.RIGHT: (-1,), Side.BOTH: (1, -1)}[self.side]

    def aside_m(self, widths_m: Array, sign: int) -> Array:
        """Offsets of its near face from the middle of a lane of ``widths_m``, on the side ``sign``."""
        return sign * (widths_m / 2 + self.distance_m)

    @property
    def trunks_m(self) -> Array:
        """Stations of the trunks of a row of trees, the middles of equal spaces."""
        count = max(round((self.to_m - self.from_m) / TREE_EVERY_M), 1)
        return self.from_m + (np.arange(count) + 0.5) * (self.to_m - self.from_m) / count
