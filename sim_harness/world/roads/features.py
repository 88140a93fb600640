"""Settings of local features of a road: marks painted on it, side roads that join it."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from sim_harness.world.roads.appearance import Paint, Surface
from trepid.config import Settings
from trepid.types import NonNegative, Positive, Share


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
    centre_line: bool = False  # a dashed white line along its axis, and a stop line at its mouth

    @property
    def mouth_m(self) -> tuple[float, float]:
        """Stations between which the edge of the road is open."""
        half_m = self.width_m / 2 + self.radius_m
        return self.at_m - half_m, self.at_m + half_m
