"""The lanes of an OpenDRIVE road along its reference line: offsets, widths, types and road marks.

ASAM OpenDRIVE 1.7.0, chapters 9.3 (lane sections), 9.4 (lane offset), 9.5 (widths) and 9.6 (road markings).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count, pairwise, takewhile

from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.opendrive.sections import FLIPPED, STROKE_NAMES
from sim_harness.world.roads.appearance import Marking, Paint, Stroke

PAVED = {"shoulder", "border", "stop", "parking", "biking", "median", "restricted", "curb"}
DRIVEN = {
    *("driving", "bidirectional", "entry", "exit", "onRamp", "offRamp", "connectingRamp"),
    *("bus", "taxi", "HOV", "slipLane", "mwyEntry", "mwyExit"),
}
_TYPES = {name.lower(): name for name in PAVED | DRIVEN}
STROKES = {name: stroke for stroke, name in STROKE_NAMES.items()} | {
    "botts dots": Stroke.DASHED,
    "custom": Stroke.SOLID,
    **dict.fromkeys(("curb", "grass", "edge"), Stroke.NONE),
}
PAINTS = {"yellow": Paint.YELLOW, "orange": Paint.YELLOW, "blue": Paint.BLUE}
MAX_DASH_M = 100.0
TEMPORARY = "temporary"  # layer of the lanes of roadworks, beside those of the road itself (version 1.9)
ROUNDING_M = 1e-3  # of stations and widths in files written with few digits


@dataclass(frozen=True, slots=True)
class CubicRecord:
    """a + b·ds + c·ds² + d·ds³ from ``start_m`` on; continues beyond its end."""

    element: Element
    start_m: float
    coefficients: tuple[float, float, float, float]

    def at(self, s: float) -> float:
        a, b, c, d = self.coefficients
        ds = s - self.start_m
        return a + ds * (b + ds * (c + ds * d))


def records(elements: Sequence[Element], place: str, origin_m: float = 0.0) -> list[CubicRecord]:
    """The cubic polynomials of ``elements``, whose attribute ``place`` counts from ``origin_m``."""
    found = [
        CubicRecord(
            e, origin_m + e.number(place), (e.number("a"), e.number("b"), e.number("c"), e.number("d"))
        )
        for e in elements
    ]
    for here, there in pairwise(found):
        if there.start_m < here.start_m - ROUNDING_M:
            least_m = here.start_m - origin_m
            raise there.element.error(f"{place} runs backwards: expected at least {least_m:g}")
    return found


def lane_type(lane: Element) -> str:
    """The type of ``lane`` in the letters of the standard: some tools write ``Driving``. Raises InputError."""
    stated = lane.text("type")
    return _TYPES.get(stated.lower(), stated)


def permanent_lanes(road: Element) -> Element:
    """The <lanes> of ``road`` without roadworks. Raises InputError without one."""
    layers = road.all("lanes")
    return next((lanes for lanes in layers if lanes.attributes.get("layer") != TEMPORARY), road.need("lanes"))


def active(found: Sequence[CubicRecord], s: float) -> CubicRecord | None:
    """The last record that starts at ``s`` or before."""
    return next((record for record in reversed(found) if record.start_m <= s), None)


class LaneSection:
    """One <laneSection>: its lanes by id, 0 being the line between left and right.

    A section of a single side (``singleSide="true"``) leaves the other side as it was before: its lanes are those
    of ``before``, with their widths and markings from there.
    """

    def __init__(self, element: Element, before: "LaneSection | None" = None) -> None:
        """Raises InputError when a lane id between 0 and another one is missing."""
        self.element = element
        self.start_m = element.number("s")
        self.lanes: dict[int, Element] = {}
        self._cubics: dict[int, tuple[list[CubicRecord], bool]] = {}
        self.origins_m: dict[int, float] = {}  # of the sOffsets of a lane: the start of its own section
        own = {
            group: [(lane.integer("id"), lane) for lane in element.all(f"{group}/lane")]
            for group in ("left", "center", "right")
        }
        single = element.attributes.get("singleSide", "false") in ("true", "1") and before is not None
        self.kept_sides = {side for side, group in ((1, "left"), (-1, "right")) if single and not own[group]}
        if before is not None:
            for lane_id, lane in before.lanes.items():
                if _sign(lane_id) in self.kept_sides:
                    self.lanes[lane_id], self.origins_m[lane_id] = lane, before.origins_m[lane_id]
        for lane_id, lane in (pair for pairs in own.values() for pair in pairs):
            if self.lanes.get(lane_id, lane) is not lane and self.origins_m[lane_id] == self.start_m:
                raise lane.error(f"id={lane_id}: this section has such a lane already")
            self.lanes[lane_id], self.origins_m[lane_id] = lane, self.start_m
        for lane_id, lane in self.lanes.items():
            inner = lane_id - _sign(lane_id)
            if lane_id and inner and inner not in self.lanes:
                raise lane.error(f"id={lane_id}: expected a lane {inner} between it and the centre")

    def kind(self, lane_id: int) -> str:
        """The type of a lane; "none" where there is no such lane."""
        return lane_type(self.lanes[lane_id]) if lane_id in self.lanes else "none"

    def carriageway(self, lane_id: int) -> list[int]:
        """``lane_id`` with the lanes up to the centre, and those beside it up to the first that is not paved."""
        inner = range(_sign(lane_id), lane_id, _sign(lane_id))
        beside = (
            takewhile(lambda n: self.kind(n) in DRIVEN | PAVED, self.outwards(lane_id, side))
            for side in (1, -1)
        )
        return sorted({lane_id, *inner, *chain.from_iterable(beside)})

    def link(self, lane_id: int, which: str) -> int | None:
        """The id of the linked "predecessor" or "successor" of a lane; None without a link or with an empty one."""
        links = self.lanes[lane_id].all(f"link/{which}")
        found = [link for link in links if link.attributes and link.attributes.get("layer") != TEMPORARY]
        return found[0].integer("id") if found else None

    def has_borders(self) -> bool:
        """Whether a lane is given by its outer border, not by its width."""
        return any(lane.all("border") and not lane.all("width") for lane in self.lanes.values())

    def _widths_or_borders(self, lane_id: int) -> tuple[list[CubicRecord], bool]:
        """The records of a lane, and whether they are of its border; of both, the widths count (chapter 9.5.2).

        Raises InputError where none holds from the start of the lane on.
        """
        if not self.has_width(lane_id):
            raise self.lanes[lane_id].error("expected a <width> or a <border> from its start on")
        return self._cubics[lane_id]

    def has_width(self, lane_id: int) -> bool:
        """Whether the file gives a lane a width, or a border, from its start on."""
        origin_m = self.origins_m[lane_id]
        if lane_id not in self._cubics:
            widths, borders = self.lanes[lane_id].all("width"), self.lanes[lane_id].all("border")
            self._cubics[lane_id] = records(widths or borders, "sOffset", origin_m), not widths
        found, _ = self._cubics[lane_id]
        return bool(found) and found[0].start_m <= origin_m + ROUNDING_M

    def width_at(self, lane_id: int, s: float, near: float) -> float:
        """Width [m] at ``s`` by the record that holds at ``near``; 0 where it is negative."""
        return max(self._polynomial_at(lane_id, s, near), 0.0)

    def check_width(self, lane_id: int, s: float) -> None:
        """Raise InputError where a lane is narrower than nothing by more than ROUNDING_M."""
        width_m = self._polynomial_at(lane_id, s, s)
        if width_m < -ROUNDING_M:
            lane = self.lanes[lane_id]
            raise lane.error(f"its width is {width_m:.4g} m at s = {s:g} m: expected at least 0")

    def _polynomial_at(self, lane_id: int, s: float, near: float) -> float:
        found, is_border = self._widths_or_borders(lane_id)
        value_m = (active(found, near) or found[0]).at(s)  # the first holds from the start of the section on
        if not is_border:
            return value_m
        sign = _sign(lane_id)
        return sign * value_m - sum(self.width_at(n, s, near) for n in range(sign, lane_id, sign))

    def centre_at(self, lane_id: int, s: float, near: float) -> float:
        """Offset [m] of the centre of a lane from lane 0, + = left.

        A width goes on below 0 by ROUNDING_M, so that the centre has a slope where a lane inside opens.
        """
        sign = _sign(lane_id)
        found = [self._polynomial_at(n, s, near) for n in range(sign, lane_id + sign, sign)]
        widths_m = [width_m if width_m > -ROUNDING_M else 0.0 for width_m in found]
        return sign * (sum(widths_m[:-1]) + widths_m[-1] / 2)

    def outwards(self, lane_id: int, sign: int) -> Iterator[int]:
        """Ids of the lanes beyond ``lane_id`` to the left (``sign`` 1) or right (-1), up to one without a width."""
        for place in count(lane_id + sign, sign):
            if place and (place not in self.lanes or not self.has_width(place)):
                return
            if place:
                yield place

    def without_width(self, lane_id: int) -> list[int]:
        """The lanes beyond ``lane_id`` on either side at which :meth:`outwards` ends for want of a width."""
        found = []
        for sign in (1, -1):
            *_, last = lane_id, *self.outwards(lane_id, sign)
            beyond = last + sign or sign  # there is no lane 0
            if beyond in self.lanes and not self.has_width(beyond):
                found.append(beyond)
        return found

    def line(self, lane_id: int, side: int, near: float) -> Marking:
        """The marking on the left (``side`` 1) or right (-1) edge of a lane at ``near``; of a pair, left first."""
        owner = lane_id if _sign(lane_id) == side else lane_id - _sign(lane_id)
        lane = self.lanes.get(owner)
        marks = lane.all("roadMark") if lane else []
        origin_m = self.origins_m[owner] if lane else self.start_m
        here = [mark for mark in marks if origin_m + mark.number("sOffset", 0.0) <= near]
        return _marking(here[-1], outwards_is_left=owner > 0) if here else Marking(stroke=Stroke.NONE)

    def breaks_m(self) -> Iterator[float]:
        """Stations at which a width or a marking changes."""
        for lane_id, lane in self.lanes.items():
            for element in (*lane.all("width"), *lane.all("border"), *lane.all("roadMark")):
                yield self.origins_m[lane_id] + element.number("sOffset", 0.0)


def successor(here: LaneSection, there: LaneSection, lane: int) -> int | None:
    """The id in ``there`` of the lane ``lane`` of ``here``; None where it ends.

    That is the linked one, by either end of the link; without any link of both, the lane of the same id.
    """
    if _sign(lane) in there.kept_sides:
        return lane
    linked = here.link(lane, "successor")
    if linked is not None:
        return linked
    back = [n for n in there.lanes if n * lane > 0 and there.link(n, "predecessor") == lane]
    if back:
        return back[0]
    same = lane in there.lanes and there.link(lane, "predecessor") is None
    taken = any(here.link(n, "successor") == lane for n in here.lanes if n * lane > 0)
    return lane if same and not taken else None


def threads(sections: Sequence[LaneSection]) -> list[dict[int, int]]:
    """For each section, the number of each lane; a lane that continues has the same number in the next section."""
    fresh = count()
    found = [{lane: next(fresh) for lane in sections[0].lanes}]
    for here, there in pairwise(sections):
        numbers: dict[int, int] = {}
        for lane, number in found[-1].items():
            following = successor(here, there, lane) if lane else 0
            if following is not None and following in there.lanes and following not in numbers:
                numbers[following] = number
        found.append({lane: numbers[lane] if lane in numbers else next(fresh) for lane in there.lanes})
    return found


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)


def _marking(mark: Element, *, outwards_is_left: bool) -> Marking:
    """The marking of a <roadMark>, whose type names the inner of two lines first, on lane 0 the left one."""
    name = mark.text("type").lower()
    if name not in STROKES:
        raise mark.error(f"type={name!r}: expected one of {', '.join(STROKES)}")
    stroke = FLIPPED.get(STROKES[name], STROKES[name]) if outwards_is_left else STROKES[name]
    if stroke == Stroke.NONE:
        return Marking(stroke=stroke)
    lines = mark.all("type/line")
    colour = mark.attributes.get("color", "standard")
    width_m = lines[0].number("width", 0.0) if lines else mark.number("width", 0.0)
    values: dict[str, object] = {"stroke": stroke}
    values["paint"] = PAINTS.get(colour, Paint.WHITE)
    if 0.0 < width_m <= 0.5:
        values["width_m"] = width_m
    dashes = [line for line in lines if line.number("space") > 0.0]
    if dashes and "dashed" in stroke and 0.0 < dashes[0].number("length") < MAX_DASH_M:
        values |= {"dash_m": dashes[0].number("length"), "gap_m": dashes[0].number("space")}
    if len(lines) == 2 and width_m > 0.0:
        apart_m = abs(lines[0].number("tOffset") - lines[1].number("tOffset")) - width_m
        values |= {"spacing_m": apart_m} if apart_m > 0.0 else {}
    return Marking.model_validate(values)
