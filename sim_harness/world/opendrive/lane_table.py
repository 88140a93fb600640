"""The lanes of an OpenDRIVE road along its reference line: offsets, widths, types and road marks.

ASAM OpenDRIVE 1.7.0, chapters 9.3 (lane sections), 9.4 (lane offset), 9.5 (widths) and 9.6 (road markings).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, pairwise

from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.opendrive.sections import FLIPPED, STROKE_NAMES
from sim_harness.world.roads.appearance import Marking, Paint, Stroke

PAVED = {"shoulder", "border", "stop", "parking", "biking", "median", "restricted", "curb"}
DRIVEN = {
    *("driving", "bidirectional", "entry", "exit", "onRamp", "offRamp", "connectingRamp"),
    *("bus", "taxi", "HOV", "slipLane", "mwyEntry", "mwyExit"),
}
STROKES = {name: stroke for stroke, name in STROKE_NAMES.items()} | {
    "botts dots": Stroke.DASHED,
    "custom": Stroke.SOLID,
    **dict.fromkeys(("curb", "grass", "edge"), Stroke.NONE),
}
MAX_DASH_M = 100.0


@dataclass(frozen=True, slots=True)
class Record:
    """a + b·ds + c·ds² + d·ds³ from ``start_m`` on; continues beyond its end."""

    element: Element
    start_m: float
    coefficients: tuple[float, float, float, float]

    def at(self, s: float) -> float:
        a, b, c, d = self.coefficients
        ds = s - self.start_m
        return a + ds * (b + ds * (c + ds * d))


def records(elements: Sequence[Element], place: str, origin_m: float = 0.0) -> list[Record]:
    """The cubic polynomials of ``elements``, whose attribute ``place`` counts from ``origin_m``."""
    found = [
        Record(e, origin_m + e.number(place), (e.number("a"), e.number("b"), e.number("c"), e.number("d")))
        for e in elements
    ]
    for here, there in pairwise(found):
        if there.start_m < here.start_m:
            least_m = here.start_m - origin_m
            raise there.element.error(f"{place} runs backwards: expected at least {least_m:g}")
    return found


def active(found: Sequence[Record], s: float) -> Record | None:
    """The last record that starts at ``s`` or before."""
    return next((record for record in reversed(found) if record.start_m <= s), None)


class LaneSection:
    """One <laneSection>: its lanes by id, 0 being the line between left and right."""

    def __init__(self, element: Element) -> None:
        """Raises InputError when a lane id between 0 and another one is missing."""
        self.element = element
        self.start_m = element.number("s")
        groups = ("left", "center", "right")
        self.lanes = {lane.integer("id"): lane for group in groups for lane in element.all(f"{group}/lane")}
        for lane_id, lane in self.lanes.items():
            inner = lane_id - _sign(lane_id)
            if lane_id and inner and inner not in self.lanes:
                raise lane.error(f"id={lane_id}: expected a lane {inner} between it and the centre")

    def kind(self, lane_id: int) -> str:
        """The type of a lane; "none" where there is no such lane."""
        return self.lanes[lane_id].text("type") if lane_id in self.lanes else "none"

    def widths(self, lane_id: int) -> list[Record]:
        """The width of a lane. Raises InputError when it is not given as <width>."""
        lane = self.lanes[lane_id]
        found = records(lane.all("width"), "sOffset", self.start_m)
        if not found or found[0].start_m > self.start_m:
            raise lane.error("expected a <width> from its start on (lane borders are not read)")
        return found

    def width_at(self, lane_id: int, s: float, near: float) -> float:
        """Width [m] at ``s`` by the record that holds at ``near``."""
        records_here = self.widths(lane_id)  # the first of them holds from the start of the section on
        return (active(records_here, near) or records_here[0]).at(s)

    def centre_at(self, lane_id: int, s: float, near: float) -> float:
        """Offset [m] of the centre of a lane from lane 0, + = left."""
        sign = _sign(lane_id)
        inner = sum(self.width_at(n, s, near) for n in range(sign, lane_id, sign))
        return sign * (inner + self.width_at(lane_id, s, near) / 2)

    def outwards(self, lane_id: int, sign: int) -> Iterator[int]:
        """Ids of the lanes beyond ``lane_id`` to the left (``sign`` 1) or right (-1)."""
        for place in count(lane_id + sign, sign):
            if place and place not in self.lanes:
                return
            if place:
                yield place

    def line(self, lane_id: int, side: int, near: float) -> Marking:
        """The marking on the left (``side`` 1) or right (-1) edge of a lane at ``near``; of a pair, left first."""
        owner = lane_id if _sign(lane_id) == side else lane_id - _sign(lane_id)
        lane = self.lanes.get(owner)
        marks = lane.all("roadMark") if lane else []
        here = [mark for mark in marks if self.start_m + mark.number("sOffset") <= near]
        return _marking(here[-1], outwards_is_left=owner > 0) if here else Marking(stroke=Stroke.NONE)

    def breaks_m(self) -> Iterator[float]:
        """Stations at which a width or a marking changes."""
        for lane in self.lanes.values():
            for element in (*lane.all("width"), *lane.all("roadMark")):
                yield self.start_m + element.number("sOffset")


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)


def _marking(mark: Element, *, outwards_is_left: bool) -> Marking:
    """The marking of a <roadMark>, whose type names the inner of two lines first, on lane 0 the left one."""
    name = mark.text("type")
    if name not in STROKES:
        raise mark.error(f"type={name!r}: expected one of {', '.join(STROKES)}")
    stroke = FLIPPED.get(STROKES[name], STROKES[name]) if outwards_is_left else STROKES[name]
    if stroke == Stroke.NONE:
        return Marking(stroke=stroke)
    lines = mark.all("type/line")
    colour = mark.attributes.get("color", "standard")
    width_m = lines[0].number("width", 0.0) if lines else mark.number("width", 0.0)
    values: dict[str, object] = {"stroke": stroke}
    values["paint"] = Paint.YELLOW if colour in ("yellow", "orange") else Paint.WHITE
    if 0.0 < width_m <= 0.5:
        values["width_m"] = width_m
    dashes = [line for line in lines if line.number("space") > 0.0]
    if dashes and "dashed" in stroke and 0.0 < dashes[0].number("length") < MAX_DASH_M:
        values |= {"dash_m": dashes[0].number("length"), "gap_m": dashes[0].number("space")}
    if len(lines) == 2 and width_m > 0.0:
        apart_m = abs(lines[0].number("tOffset") - lines[1].number("tOffset")) - width_m
        values |= {"spacing_m": apart_m} if apart_m > 0.0 else {}
    return Marking.model_validate(values)
