"""Small closed tracks as people tape them on a floor: two straights joined by bends of 180°.

A bend begins and ends with a clothoid as long as a third of the lane is wide: tape is laid by hand, and tiles
change their curvature at once.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from sim_harness.world.roads.appearance import Paint, Section, Stroke, Surface, Verge
from sim_harness.world.roads.road import RoadSettings, Segment

RAMP = 1 / 3  # length of the clothoids, in lane widths
STRAIGHT = 5.0  # length of the straights, in lane widths
TAPE = 0.11  # width of the tape, in lane widths: 24 mm on lanes of 0.22 m
DASH, GAP = 0.23, 0.11  # of a dashed line, in lane widths: 50 and 25 mm (Duckietown)


class TrackLook(NamedTuple):
    """Tape and floor."""

    floor: Verge
    left: Paint
    right: Paint | None  # None: the line `left` lies alone in the middle of the lane, and the car follows it
    dashed_left: bool = False  # the middle of a road for both ways, of which the car keeps the right half
    window_light: float = 0.0


LOOKS: Mapping[str, TrackLook] = MappingProxyType(
    {
        "white_on_mat": TrackLook(Verge.MAT, Paint.WHITE, Paint.WHITE),
        "yellow_on_mat": TrackLook(Verge.MAT, Paint.YELLOW, Paint.YELLOW),
        "duckie": TrackLook(Verge.MAT, Paint.YELLOW, Paint.WHITE, dashed_left=True),
        "white_on_wood": TrackLook(Verge.WOOD, Paint.WHITE, Paint.WHITE, window_light=0.5),
        "blue_on_wood": TrackLook(Verge.WOOD, Paint.BLUE, Paint.BLUE),
        "black_on_wood": TrackLook(Verge.WOOD, Paint.BLACK, Paint.BLACK),
        "black_on_light": TrackLook(Verge.LIGHT_FLOOR, Paint.BLACK, Paint.BLACK, window_light=0.5),
        "blue_on_light": TrackLook(Verge.LIGHT_FLOOR, Paint.BLUE, Paint.BLACK),
        "white_on_carpet": TrackLook(Verge.CARPET, Paint.WHITE, Paint.WHITE),
        "yellow_on_carpet": TrackLook(Verge.CARPET, Paint.YELLOW, Paint.WHITE),
        "single_on_mat": TrackLook(Verge.MAT, Paint.WHITE, None),
    }
)
"""Ten tapes and floors with two lines, and a single line, by name."""


def taped_track(name: str, look: TrackLook, *, lane_width_m: float, bend: float) -> RoadSettings:
    """An oval of straights and bends with the radius ``bend``, in lane widths, + = to the left.

    Its closure is exact: both halves are equal and turn by π.
    """
    radius_m, ramp_m = abs(bend) * lane_width_m, RAMP * lane_width_m
    bend_1pm = math.copysign(1 / radius_m, bend)
    half = (
        Segment(length_m=STRAIGHT / 2 * lane_width_m),
        Segment(length_m=ramp_m, curvature_1pm=(0.0, bend_1pm)),
        Segment(length_m=math.pi * radius_m - ramp_m, curvature_1pm=bend_1pm),
        Segment(length_m=ramp_m, curvature_1pm=(bend_1pm, 0.0)),
        Segment(length_m=STRAIGHT / 2 * lane_width_m),
    )
    return RoadSettings(
        name=name,
        closed=True,
        lane_width_m=lane_width_m,
        segments=half + half,
        sections=(_section(look, lane_width_m),),
    )


def _section(look: TrackLook, lane_width_m: float) -> Section:
    width_m = TAPE * lane_width_m
    dashes = {"dash_m": DASH * lane_width_m, "gap_m": GAP * lane_width_m}
    stroke = {"stroke": Stroke.DASHED, **dashes} if look.dashed_left else {"stroke": Stroke.SOLID}
    lines = {"left": {"paint": look.left, "width_m": width_m, **stroke}}
    if look.right is None:
        lines = {"middle": lines["left"], "left": {"stroke": Stroke.NONE}, "right": {"stroke": Stroke.NONE}}
    else:
        lines["right"] = {"paint": look.right, "width_m": width_m, "stroke": Stroke.SOLID}
    return Section.model_validate(
        {
            "name": "tape",
            "start_m": 0.0,
            **lines,
            "surface": Surface.FLOOR,
            "paved_left_m": 0.0,
            "paved_right_m": 0.0,
            "edge_roughness_m": 0.0,
            "patchiness": 0.0,
            "verge": look.floor,
            "window_light": look.window_light,
        }
    )
