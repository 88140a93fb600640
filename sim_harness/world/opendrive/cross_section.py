"""The part of a section that OpenDRIVE and Trepid share: widths and markings of parallel lanes."""

from dataclasses import dataclass

from sim_harness.world.roads.appearance import Marking, NeighbourLane, Section, Stroke

FLIPPED = {Stroke.SOLID_DASHED: Stroke.DASHED_SOLID, Stroke.DASHED_SOLID: Stroke.SOLID_DASHED}
SAME_M = 1e-6

Ends = tuple[float, float]  # a width at the start and at the end of the section [m]


@dataclass(frozen=True, slots=True)
class Strip:
    """A neighbour lane and the marking on its far edge."""

    width_m: Ends
    marking: Marking


@dataclass(frozen=True, slots=True)
class CrossSection:
    """The lane that the vehicle keeps, its neighbours from the inside outwards, and the carriageway beyond."""

    width_m: Ends
    left: Marking
    right: Marking
    left_lanes: tuple[Strip, ...]
    right_lanes: tuple[Strip, ...]
    paved_left_m: float
    paved_right_m: float

    def update(self) -> dict[str, object]:
        """The cross section as fields of a Section."""
        return {
            "lane_width_m": _brief(self.width_m),
            "left": self.left,
            "right": self.right,
            "far_left": Marking(stroke=Stroke.NONE),
            "left_lanes": tuple(map(_neighbour, self.left_lanes)),
            "right_lanes": tuple(map(_neighbour, self.right_lanes)),
            "paved_left_m": self.paved_left_m,
            "paved_right_m": self.paved_right_m,
        }

    def agrees_with(self, other: "CrossSection") -> bool:
        """True when both are equal within SAME_M."""
        return _names(self) == _names(other) and all(
            abs(a - b) < SAME_M for a, b in zip(_metres(self), _metres(other), strict=True)
        )


def cross_section(section: Section, lane_width_m: float) -> CrossSection:
    """The cross section of ``section`` on a road with lanes of ``lane_width_m``."""

    def strips(lanes: tuple[NeighbourLane, ...], side: int) -> tuple[Strip, ...]:
        ends = [section.lane_width_m_at_ends(side * (n + 1), lane_width_m) for n in range(len(lanes))]
        return tuple(
            Strip(width, plain(lane.marking)) for width, lane in zip(ends, lanes, strict=True) if width
        )

    left_lanes = strips(section.lanes_to_the_left, 1)
    paved_left_m = section.paved_left_m
    if not section.left_lanes:  # the lane of far_left lies on paved_left_m
        paved_left_m = max(paved_left_m - sum(max(strip.width_m) for strip in left_lanes), 0.0)
    return CrossSection(
        width_m=section.lane_width_m_at_ends(0, lane_width_m) or (lane_width_m, lane_width_m),
        left=plain(section.left),
        right=plain(section.right),
        left_lanes=left_lanes,
        right_lanes=strips(section.right_lanes, -1),
        paved_left_m=paved_left_m,
        paved_right_m=section.paved_right_m,
    )


def plain(marking: Marking) -> Marking:
    """The part of a marking that OpenDRIVE can express."""
    if marking.stroke == Stroke.NONE:
        return Marking(stroke=Stroke.NONE)
    kept: dict[str, object] = {name: getattr(marking, name) for name in ("stroke", "paint", "width_m")}
    if "dashed" in marking.stroke:
        kept |= {"dash_m": marking.dash_m, "gap_m": marking.gap_m}
    if marking.stroke not in (Stroke.SOLID, Stroke.DASHED):
        kept["spacing_m"] = marking.spacing_m
    return Marking.model_validate(kept)


def flipped(marking: Marking) -> Marking:
    """The marking in the opposite direction."""
    return marking.model_copy(update={"stroke": FLIPPED.get(marking.stroke, marking.stroke)})


def _brief(ends: Ends) -> float | Ends:
    return ends[0] if abs(ends[0] - ends[1]) < SAME_M else ends


def _neighbour(strip: Strip) -> NeighbourLane:
    return NeighbourLane(width_m=_brief(strip.width_m), marking=strip.marking)


def _markings(section: CrossSection) -> list[Marking]:
    strips = (*section.left_lanes, *section.right_lanes)
    return [section.left, section.right, *(strip.marking for strip in strips)]


def _names(section: CrossSection) -> list[object]:
    lanes = [len(section.left_lanes), len(section.right_lanes)]
    return [*lanes, *((marking.stroke, marking.paint) for marking in _markings(section))]


def _metres(section: CrossSection) -> list[float]:
    widths = [width for strip in (*section.left_lanes, *section.right_lanes) for width in strip.width_m]
    lines = [v for m in _markings(section) for v in (m.width_m, m.dash_m, m.gap_m, m.spacing_m)]
    return [*section.width_m, *widths, *lines, section.paved_left_m, section.paved_right_m]
