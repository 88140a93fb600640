"""Reads a road from an OpenDRIVE file (.xodr): one lane of one road becomes the lane that the vehicle keeps.

The lane's centre becomes the reference line, in the driving direction of the lane. Where the centre lies on the
reference line of the file, the geometry is copied; elsewhere, and along polynomials, clothoids are fitted within
0.1 mm (clothoid_fit). Pieces below 2 cm, from rounding or from an editor, belong to their neighbours, and
differences below a millimetre are none. Lanes follow their <link>. Where a lane ends, or is narrower than a lane,
the road ends. Lane widths are linear along a section of Trepid: cubic ones are cut into stretches that are
linear within 1 cm. Beside the kept lane, one without a width ends the carriageway. Elevation and superelevation
become the height and the bank of the lane (heights). Objects and signals are left out and listed in the notes;
junctions are ignored.

ASAM OpenDRIVE 1.7.0; the elements that are read are the same in versions 1.4 to 1.8.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from sim_harness.world.opendrive.clothoid_fit import FittedCurve, Knot, NoFit, clothoid, fit
from sim_harness.world.opendrive.heights import LaneHeights, LaneStretch, lane_heights
from sim_harness.world.opendrive.kept_lane import KeptLane
from sim_harness.world.opendrive.lane_table import (
    DRIVEN,
    PAVED,
    CubicRecord,
    LaneSection,
    active,
    lane_type,
    permanent_lanes,
    records,
)
from sim_harness.world.opendrive.located_xml import Element, read_xml
from sim_harness.world.opendrive.plan_view import SLIVER_M, Clothoid, Piece, plan_view
from sim_harness.world.opendrive.sections import (
    CrossSection,
    Profile,
    Strip,
    reverse_lanes,
    sections,
    user_data,
)
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.road import (
    CLOSED_WITHIN_M,
    CLOSED_WITHIN_RAD,
    TIGHTEST_1PM,
    Road,
    RoadSettings,
    Segment,
)
from trepid.config import InputError

SAME_STATION_M = 1e-6
HEADING_STEP_M = 1e-4  # of the central difference that gives the curvature of a lane of varying offset
WIDTH_TOLERANCE_M = 0.01
MIN_STRETCH_M = 1.0
CHECK_STEP_M = 5.0
MAX_SLANT_RAD = 0.5
SAME_RATE_1PM2 = 1e-12
STATED_WITHIN_M = 0.1
JUMP_M = 0.01  # of a lane's middle, that no road follows


@dataclass(frozen=True, slots=True)
class ImportedRoad:
    """A road, and notes on the contents of the file that it leaves out."""

    settings: RoadSettings
    notes: tuple[str, ...]


def read_opendrive(path: Path, *, road: str | None = None, lane: int | None = None) -> ImportedRoad:
    """The lane ``lane`` of the road with the id ``road`` in the file ``path``.

    Defaults: the first road with a driving lane, and its innermost driving lane along the reference line. Other
    roads are not judged. Raises InputError with file:line:column.
    """
    root = read_xml(path)
    if root.tag != "OpenDRIVE":
        raise root.error("expected <OpenDRIVE> as the outermost element")
    roads = root.all("road")
    ids = [element.attributes.get("id", "") for element in roads]
    if not roads:
        raise root.error("expected at least one <road>")
    if road is not None and road not in ids:
        raise root.error(f"no road has the id {road!r}; there are {', '.join(ids[:20])}")
    if road is not None and ids.count(road) > 1:
        raise roads[ids.index(road)].error(f"{ids.count(road)} roads have the id {road!r}")
    chosen = next(filter(_is_driven, roads), roads[0]) if road is None else roads[ids.index(road)]
    return _LaneReader(chosen, lane).import_road()


def _is_driven(road: Element) -> bool:
    """Whether the first lane section of ``road`` has a driving lane."""
    first = permanent_lanes(road).first("laneSection") if road.first("lanes") else None
    lanes = () if first is None else (*first.all("left/lane"), *first.all("right/lane"))
    return any(lane_type(lane) in DRIVEN for lane in lanes if "type" in lane.attributes)


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A piece of road with one geometry and one record of every lane attribute."""

    start_m: float
    end_m: float
    piece: Piece
    section: LaneSection
    threads: dict[int, int]  # lane of the section -> number of the lane through all sections
    lane: int
    offset: CubicRecord | None

    @property
    def middle_m(self) -> float:
        return (self.start_m + self.end_m) / 2

    def centre_m(self, s: float) -> float:
        """Offset of the lane's centre from the reference line at station ``s``."""
        shift_m = self.offset.at(s) if self.offset else 0.0
        return shift_m + self.section.centre_at(self.lane, s, self.middle_m)

    def check(self) -> None:
        """Raise InputError where the lane runs at more than MAX_SLANT_RAD to the reference line."""
        count = 2 + math.ceil((self.end_m - self.start_m) / CHECK_STEP_M)
        slant = max(abs(self._slant(s)) for s in np.linspace(self.start_m, self.end_m, count).tolist())
        if slant > MAX_SLANT_RAD:
            raise self.section.lanes[self.lane].error(
                f"between s = {self.start_m:g} and {self.end_m:g} m this lane leaves the reference line by"
                f" {slant:.2g} rad: expected at most {MAX_SLANT_RAD:g}"
            )

    def knot(self, s: float) -> Knot:
        """The centre of the lane at ``s``: c + o·n, heading θ + atan2(o', v·(1 - κ·o)), v the way per s."""
        x, y, heading = self.piece.pose(s)
        offset_m = self.centre_m(s)
        x, y = x - offset_m * math.sin(heading), y + offset_m * math.cos(heading)
        return Knot(x, y, heading + self._slant(s), self._curvature(s))

    def is_constant(self) -> bool:
        """True when the lane's offset from the reference line is constant."""
        places = (self.start_m, self.start_m + 0.29 * (self.end_m - self.start_m), self.middle_m, self.end_m)
        offsets = [self.centre_m(s) for s in places]
        return max(offsets) - min(offsets) < 1e-9

    def exact_m(self) -> float | None:
        """Length of the lane's centre if it is one clothoid, else None.

        It is one on the reference line and parallel to a line or an arc.
        """
        shape, offset_m = self.piece.shape, self.centre_m(self.middle_m)
        if not isinstance(shape, Clothoid) or not self.is_constant():
            return None
        if abs(offset_m) > 1e-9 and shape.rate_1pm2:
            return None
        return (self.end_m - self.start_m) * (1.0 - shape.curvature_1pm * offset_m)

    def way(self, s: float) -> float:
        """Way along the lane's centre, per station."""
        return math.hypot(self._slope(s), self._along(s))

    def _slope(self, s: float) -> float:
        h = HEADING_STEP_M
        return (self.centre_m(s + h) - self.centre_m(s - h)) / (2 * h)

    def _slant(self, s: float) -> float:
        """Heading of the lane's centre relative to the reference line."""
        return math.atan2(self._slope(s), self._along(s))

    def _along(self, s: float) -> float:
        """Way of the lane's centre along the reference line, per station."""
        return self.piece.speed(s) * (1.0 - self.piece.curvature(s) * self.centre_m(s))

    def _curvature(self, s: float) -> float:
        curvature, offset_m = self.piece.curvature(s), self.centre_m(s)
        if self.is_constant():
            return curvature / (1.0 - curvature * offset_m)
        h = HEADING_STEP_M
        turn = curvature * self.piece.speed(s) + (self._slant(s + h) - self._slant(s - h)) / (2 * h)
        return turn / self.way(s)


class _LaneReader:
    """Reads one lane of one road."""

    def __init__(self, road: Element, lane: int | None) -> None:
        self._road = road
        self._pieces = plan_view(road)
        self._length_m = self._pieces[-1].start_m + self._pieces[-1].length_m
        self._offsets = records(permanent_lanes(road).all("laneOffset"), "s")
        shifted = [record for record in self._offsets if any(record.coefficients)]
        rule = road.attributes.get("rule", "RHT").upper()
        if rule not in ("RHT", "LHT"):
            raise road.error(f"rule={rule!r}: expected RHT or LHT")
        forward_sign = -1 if rule == "RHT" else 1
        self._lane = KeptLane(road, self._length_m, lane=lane, forward_sign=forward_sign)
        if shifted and any(section.has_borders() for section in self._lane.sections):
            what = (
                "a lane offset other than 0 in a road with lane borders has no defined meaning: give widths"
            )
            raise shifted[0].element.error(what)
        self._backward = self._lane.ids[0] * forward_sign < 0

    def import_road(self) -> ImportedRoad:
        stretches = self._stretches()
        spans = [FittedCurve(s.start_m, s.end_m, s.knot, s.exact_m()) for s in stretches]
        closed = self._is_closed(spans)
        try:
            fitted = fit(spans, closed=closed)
        except NoFit as error:
            raise self._fit_refusal(error.span, spans, str(error)) from error
        along = [
            LaneStretch(s.start_m, s.end_m, s.centre_m, s.way, math.fsum(piece.length_m for piece in pieces))
            for s, pieces in zip(stretches, fitted, strict=True)
        ]
        heights = lane_heights(self._road, along, backward=self._backward, closed=closed)
        lanes = [self._cross_section(stretch) for stretch in stretches]
        elements = [stretch.section.element for stretch in stretches]
        if self._backward:
            fitted = [
                [_turn_segment(segment) for segment in reversed(segments)] for segments in reversed(fitted)
            ]
            lanes, elements = [reverse_lanes(profile) for profile in reversed(lanes)], elements[::-1]
        lengths_m = [math.fsum(segment.length_m for segment in segments) for segments in fitted]
        starts_m = [math.fsum(lengths_m[:number]) for number in range(len(fitted))]
        stations_m = [stretch.end_m if self._backward else stretch.start_m for stretch in stretches]
        parts = (stations_m[::-1] if self._backward else stations_m, starts_m, lengths_m, lanes)
        profiles = [Profile(*each) for each in zip(elements, *parts, strict=True)]
        settings = self._settings(profiles, fitted, heights, closed=closed)
        return ImportedRoad(settings, self._notes(heights.kinks))

    def _fit_refusal(self, span: FittedCurve, spans: list[FittedCurve], what: str) -> InputError:
        """The refusal of a curve that no road follows, with its reason."""
        for here, there in pairwise(spans):
            before, after = here.at(here.end), there.at(there.start)
            jump_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
            if span in (here, there) and jump_m > JUMP_M:
                section = self._lane.sections[self._lane.index_at(there.start)]
                lane = section.lanes[self._lane.ids[self._lane.index_at(there.start)]]
                return lane.error(f"the middle of this lane jumps by {jump_m:.3g} m at s = {there.start:g} m")
        bends = ((abs(each.at(s).curvature_1pm), s, each) for each in spans for s in _places(each))
        sharpest_1pm, station_m, bent = max(bends, key=lambda bend: bend[0])
        if sharpest_1pm > TIGHTEST_1PM:
            radius_m, least_m = 1 / sharpest_1pm, 1 / TIGHTEST_1PM
            what, span = f"the lane bends with R = {radius_m:.2g} m, and no road below {least_m:g} m", bent
        else:
            station_m = span.start
        piece = next(
            (p for p in reversed(self._pieces) if p.start_m <= station_m + SAME_STATION_M), self._pieces[0]
        )
        place = f"between s = {span.start:g} and {span.end:g} m"
        return piece.element.error(f"lane {self._lane.ids[self._lane.index_at(station_m)]}: {what} {place}")

    def _stretches(self) -> list[_Stretch]:
        """The road cut at every change of geometry, offset, section, width or marking; slivers are not cut off."""
        places = {piece.start_m for piece in self._pieces} | {record.start_m for record in self._offsets}
        places |= {section.start_m for section in self._lane.sections}
        places |= {place for section in self._lane.sections for place in section.breaks_m()}
        cuts = [self._lane.begin_m]
        for place in sorted(
            place for place in places if self._lane.begin_m < place < self._lane.end_m - SLIVER_M
        ):
            if place > cuts[-1] + SLIVER_M:
                cuts.append(place)
        coarse = [self._stretch(*ends) for ends in pairwise([*cuts, self._lane.end_m])]
        for stretch in coarse:
            stretch.check()
        return [fine for stretch in coarse for fine in self._linear_widths(stretch)]

    def _stretch(self, start_m: float, end_m: float) -> _Stretch:
        middle_m = (start_m + end_m) / 2
        piece = next(p for p in reversed(self._pieces) if p.start_m <= middle_m or p is self._pieces[0])
        index = self._lane.index_at(middle_m)
        kept = self._lane
        section, numbers, lane = kept.sections[index], kept.threads[index], kept.ids[index]
        offset = active(self._offsets, middle_m)
        return _Stretch(start_m, end_m, piece, section, numbers, lane, offset)

    def _linear_widths(self, stretch: _Stretch) -> list[_Stretch]:
        """``stretch``, halved until the lane widths are linear within WIDTH_TOLERANCE_M."""
        start_m, middle_m, end_m = stretch.start_m, stretch.middle_m, stretch.end_m
        section = stretch.section
        for lane in (n for n in section.carriageway(stretch.lane) if section.kind(n) in DRIVEN):
            section.check_width(lane, middle_m)
            if end_m - start_m > 3 * SLIVER_M:
                section.check_width(lane, start_m + SLIVER_M)
                section.check_width(lane, end_m - SLIVER_M)
            places = np.linspace(start_m, end_m, 5).tolist()
            first, *inner, last = (section.width_at(lane, s, middle_m) for s in places)
            chord = np.linspace(first, last, 5)[1:-1]
            bent_m = float(np.abs(inner - chord).max())
            if bent_m > WIDTH_TOLERANCE_M and end_m - start_m > MIN_STRETCH_M:
                halves = (start_m, middle_m), (middle_m, end_m)
                return [part for half in halves for part in self._linear_widths(self._stretch(*half))]
        return [stretch]

    def _is_closed(self, spans: list[FittedCurve]) -> bool:
        """True when the road is its own successor. Raises InputError when its end misses its start."""
        link = self._road.first("link/successor")
        own_start = {"elementId": self._road.text("id"), "contactPoint": "start"}
        if not self._lane.is_whole() or link is None or not own_start.items() <= link.attributes.items():
            return False
        first, last = spans[0].at(spans[0].start), spans[-1].at(spans[-1].end)
        gap_m = math.hypot(last.x_m - first.x_m, last.y_m - first.y_m)
        turn_rad = abs(math.remainder(last.heading_rad - first.heading_rad, math.tau))
        if gap_m > CLOSED_WITHIN_M or turn_rad > CLOSED_WITHIN_RAD:
            raise link.error(f"the road is its own successor, but its end misses its start by {gap_m:.4f} m")
        return True

    def _cross_section(self, stretch: _Stretch) -> CrossSection:
        """The lanes of a stretch in the direction of the reference line."""
        section, kept, near = stretch.section, stretch.lane, stretch.middle_m

        def ends(lane: int) -> tuple[float, float]:
            start_m, end_m = (section.width_at(lane, s, near) for s in (stretch.start_m, stretch.end_m))
            return start_m, end_m

        def side(sign: int) -> tuple[tuple[Strip, ...], float]:
            strips: list[Strip] = []
            paved_m = 0.0
            for lane in section.outwards(kept, sign):
                kind = section.kind(lane)
                if kind in DRIVEN and paved_m == 0.0:
                    strips.append(Strip(ends(lane), section.line(lane, sign, near), stretch.threads[lane]))
                elif kind in DRIVEN or kind in PAVED:
                    paved_m += sum(ends(lane)) / 2
                else:
                    break
            return tuple(strips), max(paved_m, 0.0)

        left_lanes, paved_left_m = side(1)
        right_lanes, paved_right_m = side(-1)
        return CrossSection(
            width_m=ends(kept),
            left=section.line(kept, 1, near),
            right=section.line(kept, -1, near),
            left_lanes=left_lanes,
            right_lanes=right_lanes,
            paved_left_m=paved_left_m,
            paved_right_m=paved_right_m,
        )

    def _settings(
        self, profiles: list[Profile], fitted: list[list[Segment]], heights: LaneHeights, *, closed: bool
    ) -> RoadSettings:
        exported = not self._backward and set(self._lane.ids) == {-1}  # then the <userData> applies
        values: dict[str, object] = {
            "name": self._road.attributes.get("name") or f"road_{self._road.text('id')}",
            "lane_width_m": profiles[0].lanes.width_m[0],
            **(user_data(self._road) if exported else {}),
            **({"elevation": heights.elevation} if heights.elevation else {}),
            **({"bank": heights.bank} if heights.bank else {}),
            "closed": closed,
            "segments": _merge_segments(fitted),
            "sections": (Section(name="", start_m=0),),
        }
        try:
            width_m = RoadSettings.model_validate({**values, "marks": ()}).lane_width_m
            values["sections"] = sections(profiles, width_m, with_user_data=exported)
            settings = RoadSettings.model_validate(values)
            Road(settings)
        except ValidationError as error:
            raise replace(profiles[0], element=self._road).error(error) from error
        except ValueError as error:
            raise self._road.error(f"{self._lane.name}: {error}") from error
        return settings

    def _notes(self, kinks: int) -> tuple[str, ...]:
        notes = self._lane.notes()
        stated_m = self._road.number("length", self._length_m)
        if abs(stated_m - self._length_m) > STATED_WITHIN_M:
            notes.append(f"length={stated_m:g}: its geometries are {self._length_m:g} m long")
        if kinks:
            notes.append(f"the grade or the bank jumps at {kinks} places: rounded off over 1 m")
        for section, lane in zip(self._lane.sections, self._lane.ids, strict=True):
            for other in section.without_width(lane):
                what = f"lane {other} has no width from s = {section.start_m:g} m on"
                notes.append(f"{what}: it and what lies beyond are left out")
        for kind in ("object", "signal"):
            if found := self._road.all(f"{kind}s/{kind}"):
                notes.append(f"left out: {len(found)} {kind}s")
        return tuple(notes)


def _places(span: FittedCurve) -> list[float]:
    return [float(s) for s in np.linspace(span.start, span.end, 20)]


def _turn_segment(segment: Segment) -> Segment:
    return clothoid(segment.length_m, -segment.end_curvature_1pm, -segment.start_curvature_1pm)


def _merge_segments(fitted: list[list[Segment]]) -> tuple[Segment, ...]:
    """The segments in one list; neighbours of equal curvature rate are joined."""
    out: list[Segment] = []
    for segment in (segment for segments in fitted for segment in segments):
        if out and abs(_rate(out[-1]) - _rate(segment)) < SAME_RATE_1PM2:
            out[-1] = clothoid(
                out[-1].length_m + segment.length_m, out[-1].start_curvature_1pm, segment.end_curvature_1pm
            )
        else:
            out.append(segment)
    return tuple(out)


def _rate(segment: Segment) -> float:
    return (segment.end_curvature_1pm - segment.start_curvature_1pm) / segment.length_m
