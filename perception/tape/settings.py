"""``config/tape.yaml``."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, Positive, PositiveShare


class Lines(StrEnum):
    """Where the lines of a lane lie."""

    BOTH = "both"  # on its two sides
    MIDDLE = "middle"  # one, in its middle: the car follows it


class YellowSide(StrEnum):
    """The side on which yellow lines bound the lane."""

    ANY = "any"
    LEFT = "left"
    RIGHT = "right"


class RoleSettings(Settings):
    """Section ``lane``: the lines of the track."""

    lines: Lines
    yellow: YellowSide
    widths: Annotated[tuple[Annotated[float, Field(ge=0.5, le=4)], ...], Field(min_length=1, max_length=3)]

    @property
    def aside(self) -> float:
        """Distance of the lines from the middle of the lane, by its width."""
        return 0.5 if self.lines is Lines.BOTH else 0.0


class FloorSettings(Settings):
    """Section ``floor``: the raster and the lines on it."""

    reach_m: Positive
    half_width_m: Positive
    cell_m: Positive
    widest: Positive  # tangent of the angle from the axis of the lens beyond which nothing is read
    least_sigmas: Positive
    least_grey: Positive
    most_points: Annotated[int, Field(ge=50, le=2000)]


class MemorySettings(Settings):
    """Section ``memory``: lines that have left the image."""

    keep_m: Positive
    behind_m: Positive
    most_points: Annotated[int, Field(ge=50, le=2000)]


class StepSettings(Settings):
    """How far a lane may be from where a fit begins."""

    offset_m: Positive
    heading_rad: Positive
    bend_1pm: Positive


class CurveSettings(Settings):
    """Section ``curve``: the lane by length, and its fit."""

    stations_m: Annotated[tuple[float, ...], Field(min_length=4)]
    bend_1pm: Positive
    bend_change_1pm_per_sqrt_m: Positive
    point_sigma_m: Positive
    scales_m: Annotated[tuple[Positive, ...], Field(min_length=1)]
    width_sigma: Positive
    slant_rad: Positive
    step: StepSettings
    searched: StepSettings


class SearchSettings(Settings):
    """Section ``search``: lanes without a memory."""

    offset_m: Positive
    offsets: Annotated[int, Field(ge=3, le=31)]
    heading_rad: Positive
    headings: Annotated[int, Field(ge=3, le=31)]
    bend_1pm: Positive
    bends: Annotated[int, Field(ge=3, le=31)]
    tried: Annotated[int, Field(ge=1, le=10)]


class SureSettings(Settings):
    """Section ``sure``: the confidence."""

    near_m: Positive
    line_m: Positive
    least_line_m: Positive
    share: PositiveShare
    aim_sigma_m: Positive
    looks: Annotated[int, Field(ge=1)]
    coast_m: Positive
    forget_m: Positive
    least: NonNegative
    plain: PositiveShare


class TapeSettings(Settings):
    """``config/tape.yaml``."""

    lookahead_m: Positive
    lane: RoleSettings
    floor: FloorSettings
    memory: MemorySettings
    curve: CurveSettings
    search: SearchSettings
    sure: SureSettings
