"""The part of a section that OpenDRIVE and Trepid share: widths and markings of parallel lanes."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from pydantic import ValidationError

from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.roads.appearance import Marking, NeighbourLane, Paint, Section, Stroke
from trepid.config import InputError

USER_DATA = "trepid"  # code of the <userData> that the export writes
STROKE_NAMES = {  # both name the left of two lines first
    Stroke.NONE: "none",
    Stroke.SOLID: "solid",
    Stroke.DASHED: "broken",
    Stroke.DOUBLE_SOLID: "solid solid",
    Stroke.DOUBLE_DASHED: "broken broken",
    Stroke.SOLID_DASHED: "solid broken",
    Stroke.DASHED_SOLID: "broken solid",
}
FLIPPED = {Stroke.SOLID_DASHED: Stroke.DASHED_SOLID, Stroke.DASHED_SOLID: Stroke.SOLID_DASHED}
SAME_M = 1e-6
JOINED_WITHIN_M = 0.01  # widths that differ by less at a joint are taken as equal

Ends = tuple[float, float]  # a width at the start and at the end of the section [m]


@dataclass(frozen=True, slots=True)
class Strip:
    """A neighbour lane and the marking on its far edge.

    ``lane`` is the same number in all sections through which the file links the lane; None without a file.
    """

    width_m: Ends
    marking: Marking
    lane: int | None = None


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

    @property
    def strips(self) -> tuple[Strip, ...]:
        """All neighbour lanes, those to the left first."""
        return (*self.left_lanes, *self.right_lanes)

    @property
    def widths(self) -> list[Ends]:
        """Widths of the kept lane and of all strips."""
        return [self.width_m, *(strip.width_m for strip in self.strips)]

    def with_widths(self, widths: Sequence[Ends]) -> "CrossSection":
        """The same lanes with other ``widths``."""
        left, pairs = len(self.left_lanes), zip(widths[1:], self.strips, strict=True)
        strips = tuple(replace(strip, width_m=width_m) for width_m, strip in pairs)
        return replace(self, width_m=widths[0], left_lanes=strips[:left], right_lanes=strips[left:])

    def fields(self) -> dict[str, object]:
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
        mine, its = list(self._values()), list(other._values())
        return len(mine) == len(its) and all(
            abs(a - b) < SAME_M if isinstance(a, float) and isinstance(b, float) else a == b
            for a, b in zip(mine, its, strict=True)
        )

    def _values(self) -> Iterator[object]:
        yield from (len(self.left_lanes), len(self.right_lanes), self.paved_left_m, self.paved_right_m)
        for width in self.widths:
            yield from width
        for line in (self.left, self.right, *(strip.marking for strip in self.strips)):
            yield from (line.stroke, line.paint, line.width_m, line.dash_m, line.gap_m, line.spacing_m)


@dataclass(frozen=True, slots=True)
class Profile:
    """A cross section from ``start_m`` over ``length_m`` of the new road, and its place in the file."""

    element: Element  # its <laneSection>
    station_m: float  # in the file
    start_m: float
    length_m: float
    lanes: CrossSection

    def error(self, error: ValidationError) -> InputError:
        """The refusal of a section of these lanes."""
        problem = error.errors()[0]
        field = ".".join(map(str, problem["loc"]))
        what = problem["msg"].removeprefix("Value error, ")
        return self.element.error(f"at s = {self.station_m:g} m: {f'{field}: ' if field else ''}{what}")


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
    kept = {"stroke", "paint", "width_m"}
    if "dashed" in marking.stroke:
        kept |= {"dash_m", "gap_m"}
    if marking.stroke not in (Stroke.SOLID, Stroke.DASHED):
        kept.add("spacing_m")
    paint = Paint.WHITE if marking.paint is Paint.BLACK else marking.paint
    return Marking.model_validate(marking.model_dump(include=kept) | {"paint": paint})


def flip_marking(marking: Marking) -> Marking:
    """The marking in the opposite direction."""
    return marking.model_copy(update={"stroke": FLIPPED.get(marking.stroke, marking.stroke)})


def reverse_lanes(lanes: CrossSection) -> CrossSection:
    """``lanes`` in the opposite direction."""

    def turn_strips(strips: tuple[Strip, ...]) -> tuple[Strip, ...]:
        return tuple(
            replace(strip, width_m=strip.width_m[::-1], marking=flip_marking(strip.marking))
            for strip in strips
        )

    return CrossSection(
        width_m=lanes.width_m[::-1],
        left=flip_marking(lanes.right),
        right=flip_marking(lanes.left),
        left_lanes=turn_strips(lanes.right_lanes),
        right_lanes=turn_strips(lanes.left_lanes),
        paved_left_m=lanes.paved_right_m,
        paved_right_m=lanes.paved_left_m,
    )


def sections(profiles: Sequence[Profile], lane_width_m: float, *, with_user_data: bool) -> list[Section]:
    """The fewest sections that describe ``profiles``. Raises InputError for a lane that no section can have."""
    groups: list[Profile] = []
    for profile in (replace(each, lanes=_plain_widths(each.lanes)) for each in profiles):
        longer = _join_profiles(groups[-1], profile) if groups else None
        groups[-1:] = [longer] if longer else [*groups[-1:], profile]
    for number in range(1, len(groups)):
        met = _meeting(groups[number - 1].lanes, groups[number].lanes)
        groups[number] = replace(groups[number], lanes=met)
    found = []
    for group in groups:
        try:
            found.append(_section(group, lane_width_m, with_user_data=with_user_data))
        except ValidationError as error:
            raise group.error(error) from error
    return found


def user_data(element: Element) -> dict[str, object]:
    """The <userData> that export wrote into ``element``; empty without one. Raises InputError."""
    found = [data for data in element.all("userData") if data.attributes.get("code") == USER_DATA]
    if not found:
        return {}
    try:
        data = json.loads(found[0].text("value"))
    except ValueError as error:
        raise found[0].error(f"value: expected JSON: {error}") from error
    if not isinstance(data, dict):
        raise found[0].error("value: expected a JSON object")
    return data


def _section(profile: Profile, lane_width_m: float, *, with_user_data: bool) -> Section:
    """The section of ``profile``. The lanes override <userData>, so that other tools may edit the file."""
    place: dict[str, object] = {"name": f"at_{profile.start_m:.0f}", "start_m": profile.start_m}
    if with_user_data:
        own = user_data(profile.element)
        base = Section.model_validate({**place, **own})
        if own and cross_section(base, lane_width_m).agrees_with(profile.lanes):
            return base
        place = dict(base)
    return Section.model_validate({**place, **profile.lanes.fields()})


def _join_profiles(a: Profile, b: Profile) -> Profile | None:
    """Both profiles as one, None where they differ."""
    if a.element is not b.element or len(a.lanes.widths) != len(b.lanes.widths):
        return None
    share = a.length_m / (a.length_m + b.length_m)
    ends = [(x[0], y[1]) for x, y in zip(a.lanes.widths, b.lanes.widths, strict=True)]
    cuts = [(start, start + (end - start) * share, end) for start, end in ends]
    first = a.lanes.with_widths([(start, cut) for start, cut, _ in cuts])
    second = a.lanes.with_widths([(cut, end) for _, cut, end in cuts])
    if not (first.agrees_with(a.lanes) and second.agrees_with(b.lanes)):
        return None
    return replace(a, length_m=a.length_m + b.length_m, lanes=a.lanes.with_widths(ends))


def _meeting(before: CrossSection, after: CrossSection) -> CrossSection:
    """``after``, with each lane that continues starting at the width with which it ends in ``before``.

    The kept lane does so within JOINED_WITHIN_M. A neighbour continues where both have the same lane of the file;
    without a file, where it has the same place. Where lanes of one side end and others begin at a width, the others
    begin at 0: a road of Trepid opens or closes lanes at a joint, not both.
    """

    def strips(there: tuple[Strip, ...], here: tuple[Strip, ...]) -> tuple[Strip, ...]:
        ending = {_key(k, strip): strip for k, strip in enumerate(there)}
        met, opened = [], []
        for k, strip in enumerate(here):
            found = ending.pop(_key(k, strip), None)
            if found is None and strip.width_m[0] > 0:
                opened.append(k)
            met.append(
                strip if found is None else replace(strip, width_m=_start(found.width_m, strip.width_m))
            )
        if any(strip.width_m[1] > 0 for strip in ending.values()):
            for k in opened:
                met[k] = replace(met[k], width_m=(0.0, met[k].width_m[1]))
        return tuple(met)

    kept_m = after.width_m
    if abs(before.width_m[1] - kept_m[0]) < JOINED_WITHIN_M:
        kept_m = _start(before.width_m, kept_m)
    return replace(
        after,
        width_m=kept_m,
        left_lanes=strips(before.left_lanes, after.left_lanes),
        right_lanes=strips(before.right_lanes, after.right_lanes),
    )


def _key(place: int, strip: Strip) -> tuple[bool, int]:
    """What tells a neighbour from the others of its side: its lane in the file, else its place."""
    return (True, place) if strip.lane is None else (False, strip.lane)


def _start(there: Ends, here: Ends) -> Ends:
    """``here``, starting at the end of ``there``."""
    if abs(here[0] - here[1]) < SAME_M and abs(there[1] - here[0]) < SAME_M:
        return there[1], there[1]
    return _flat((there[1], here[1]))


def _flat(ends: Ends) -> Ends:
    return (ends[0], ends[0]) if abs(ends[0] - ends[1]) < SAME_M else ends


def _plain_widths(lanes: CrossSection) -> CrossSection:
    """``lanes`` without differences of rounding between the ends of a lane."""
    return lanes.with_widths([_flat(ends) for ends in lanes.widths])


def _brief(ends: Ends) -> float | Ends:
    return ends[0] if abs(ends[0] - ends[1]) < SAME_M else ends


def _neighbour(strip: Strip) -> NeighbourLane:
    return NeighbourLane(width_m=_brief(strip.width_m), marking=strip.marking)
