"""Reads a road from an OpenDRIVE file (.xodr): one lane of one road becomes the lane that the vehicle keeps.

The lane's centre becomes the reference line, in the driving direction of the lane. Where the centre lies on the
reference line of the file, the geometry is copied; elsewhere, and along polynomials, clothoids are fitted within
0.1 mm (clothoid_fit). Lane widths are linear along a section of Trepid: cubic ones are cut into stretches that are
linear within 1 cm. Elevation, superelevation, objects and signals are left out and listed in the notes; junctions
are ignored.

ASAM OpenDRIVE 1.7.0; the elements that are read are the same in versions 1.4 to 1.8.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from sim_harness.world.opendrive.clothoid_fit import Knot, NoFit, Span, clothoid, fit
from sim_harness.world.opendrive.lane_table import DRIVEN, PAVED, LaneSection, Record, active, records
from sim_harness.world.opendrive.located_xml import Element, read_xml
from sim_harness.world.opendrive.plan_view import Clothoid, Piece, plan_view
from sim_harness.world.opendrive.sections import CrossSection, Profile, Strip, mirrored, sections, user_data
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.road import CLOSED_WITHIN_M, CLOSED_WITHIN_RAD, Road, RoadSettings, Segment

SAME_STATION_M = 1e-6
HEADING_STEP_M = 1e-4  # of the central difference that gives the curvature of a lane of varying offset
WIDTH_TOLERANCE_M = 0.01
MIN_STRETCH_M = 1.0
CHECK_STEP_M = 5.0
MAX_SLANT_RAD = 0.5
SAME_RATE_1PM2 = 1e-12


@dataclass(frozen=True, slots=True)
class Imported:
    """A road, and notes on the contents of the file that it leaves out."""

    settings: RoadSettings
    notes: tuple[str, ...]


def read_opendrive(path: Path, *, road: str | None = None, lane: int | None = None) -> Imported:
    """The lane ``lane`` of the road with the id ``road`` in the file ``path``.

    Defaults: the first road, and its innermost driving lane along the reference line. Raises InputError with
    file:line:column.
    """
    root = read_xml(path)
    if root.tag != "OpenDRIVE":
        raise root.error("expected <OpenDRIVE> as the outermost element")
    roads = root.all("road")
    ids = [element.text("id") for element in roads]
    if not roads:
        raise root.error("expected at least one <road>")
    if road is not None and road not in ids:
        raise root.error(f"no road has the id {road!r}; there are {', '.join(ids[:20])}")
    return _Reader(roads[0 if road is None else ids.index(road)], lane).imported()


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A piece of road with one geometry and one record of every lane attribute."""

    start_m: float
    end_m: float
    piece: Piece
    section: LaneSection
    lane: int
    offset: Record | None

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
        """The centre of the lane at ``s``: c + o·n, its heading θ + atan2(o', 1 - κ·o)."""
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

    def _slope(self, s: float) -> float:
        h = HEADING_STEP_M
        return (self.centre_m(s + h) - self.centre_m(s - h)) / (2 * h)

    def _slant(self, s: float) -> float:
        """Heading of the lane's centre relative to the reference line."""
        return math.atan2(self._slope(s), 1.0 - self.piece.curvature(s) * self.centre_m(s))

    def _curvature(self, s: float) -> float:
        curvature, offset_m = self.piece.curvature(s), self.centre_m(s)
        if self.is_constant():
            return curvature / (1.0 - curvature * offset_m)
        h = HEADING_STEP_M
        turn = curvature + (self._slant(s + h) - self._slant(s - h)) / (2 * h)
        return turn / math.hypot(self._slope(s), 1.0 - curvature * offset_m)


class _Reader:
    """Reads one lane of one road."""

    def __init__(self, road: Element, lane: int | None) -> None:
        self._road = road
        self._pieces = plan_view(road)
        self._length_m = self._pieces[-1].start_m + self._pieces[-1].length_m
        self._sections = [LaneSection(element) for element in road.need("lanes").all("laneSection")]
        if not self._sections:
            raise road.need("lanes").error("expected at least one <laneSection>")
        for section, min_m in zip(self._sections, [0.0, *(s.start_m for s in self._sections)], strict=False):
            if section.start_m < min_m or (section is self._sections[0] and section.start_m > 0.0):
                raise section.element.error(f"s={section.start_m:g}: expected rising s from 0 on")
        self._offsets = records(road.all("lanes/laneOffset"), "s")
        rule = road.attributes.get("rule", "RHT")
        if rule not in ("RHT", "LHT"):
            raise road.error(f"rule={rule!r}: expected RHT or LHT")
        self._forward_sign = -1 if rule == "RHT" else 1
        self._lanes = self._followed(self._first_lane(lane))
        self._backward = self._lanes[0] * self._forward_sign < 0

    def imported(self) -> Imported:
        stretches = self._stretches()
        spans = [Span(s.start_m, s.end_m, s.knot, s.exact_m()) for s in stretches]
        closed = self._closed(spans)
        try:
            fitted = fit(spans, closed=closed)
        except NoFit as error:
            piece = next(p for p in reversed(self._pieces) if p.start_m <= error.span.start + SAME_STATION_M)
            place = f"between s = {error.span.start:g} and {error.span.end:g} m"
            raise piece.element.error(f"{error} {place}") from error
        lanes = [self._cross_section(stretch) for stretch in stretches]
        elements = [stretch.section.element for stretch in stretches]
        if self._backward:
            fitted = [[_turned(segment) for segment in reversed(segments)] for segments in reversed(fitted)]
            lanes, elements = [mirrored(profile) for profile in reversed(lanes)], elements[::-1]
        lengths_m = [math.fsum(segment.length_m for segment in segments) for segments in fitted]
        starts_m = [math.fsum(lengths_m[:number]) for number in range(len(fitted))]
        profiles = [Profile(*parts) for parts in zip(elements, starts_m, lengths_m, lanes, strict=True)]
        return Imported(self._settings(profiles, fitted, closed=closed), self._notes())

    def _first_lane(self, lane: int | None) -> int:
        """The id of the chosen lane in the first lane section."""
        section = self._sections[0]
        driving = sorted((n for n in section.lanes if n and section.kind(n) in DRIVEN), key=abs)
        if not driving:
            raise section.element.error("expected a lane of type driving")
        if lane is None:
            ahead = [n for n in driving if n * self._forward_sign > 0]
            return (ahead or driving)[0]
        if lane not in driving:
            raise section.element.error(f"no driving lane {lane}; there are {', '.join(map(str, driving))}")
        return lane

    def _followed(self, lane: int) -> list[int]:
        """The id of the lane in every section: the linked successor, or the same id without a link."""
        lanes = [lane]
        for here, there in pairwise(self._sections):
            link = here.lanes[lanes[-1]].first("link/successor")
            following = link.integer("id") if link else lanes[-1]
            if following not in there.lanes or following * lane <= 0:
                raise there.element.error(f"lane {lanes[-1]} ends here: expected a lane {following}")
            lanes.append(following)
        return lanes

    def _stretches(self) -> list[_Stretch]:
        """The road cut at every change of geometry, offset, section, width or marking."""
        places = {piece.start_m for piece in self._pieces} | {record.start_m for record in self._offsets}
        places |= {section.start_m for section in self._sections}
        places |= {place for section in self._sections for place in section.breaks_m()}
        cuts = [0.0]
        for place in sorted(place for place in places if 0.0 < place < self._length_m - SAME_STATION_M):
            if place > cuts[-1] + SAME_STATION_M:
                cuts.append(place)
        coarse = [self._stretch(*ends) for ends in pairwise([*cuts, self._length_m])]
        for stretch in coarse:
            stretch.check()
        return [fine for stretch in coarse for fine in self._linear_widths(stretch)]

    def _stretch(self, start_m: float, end_m: float) -> _Stretch:
        middle_m = (start_m + end_m) / 2
        piece = next(p for p in reversed(self._pieces) if p.start_m <= middle_m or p is self._pieces[0])
        index = next((i for i, s in reversed(list(enumerate(self._sections))) if s.start_m <= middle_m), 0)
        section, lane = self._sections[index], self._lanes[index]
        return _Stretch(start_m, end_m, piece, section, lane, active(self._offsets, middle_m))

    def _linear_widths(self, stretch: _Stretch) -> list[_Stretch]:
        """``stretch``, halved until the lane widths are linear within WIDTH_TOLERANCE_M."""
        start_m, middle_m, end_m = stretch.start_m, stretch.middle_m, stretch.end_m
        section = stretch.section
        for lane in (n for n in section.lanes if n and section.kind(n) in DRIVEN):
            places = np.linspace(start_m, end_m, 5).tolist()
            first, *inner, last = (section.width_at(lane, s, middle_m) for s in places)
            chord = np.linspace(first, last, 5)[1:-1]
            bent_m = float(np.abs(inner - chord).max())
            if bent_m > WIDTH_TOLERANCE_M and end_m - start_m > MIN_STRETCH_M:
                halves = (start_m, middle_m), (middle_m, end_m)
                return [part for half in halves for part in self._linear_widths(self._stretch(*half))]
        return [stretch]

    def _closed(self, spans: list[Span]) -> bool:
        """True when the road is its own successor. Raises InputError when its end misses its start."""
        link = self._road.first("link/successor")
        own_start = {"elementId": self._road.text("id"), "contactPoint": "start"}
        if link is None or not own_start.items() <= link.attributes.items():
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
                    strips.append(Strip(ends(lane), section.line(lane, sign, near)))
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
        self, profiles: list[Profile], fitted: list[list[Segment]], *, closed: bool
    ) -> RoadSettings:
        exported = not self._backward and set(self._lanes) == {-1}  # then the <userData> applies
        values: dict[str, object] = {
            "name": self._road.attributes.get("name") or f"road_{self._road.text('id')}",
            "lane_width_m": profiles[0].lanes.width_m[0],
            **(user_data(self._road) if exported else {}),
            "closed": closed,
            "segments": _merged(fitted),
            "sections": (Section(name="", start_m=0),),
        }
        try:
            width_m = RoadSettings.model_validate({**values, "marks": ()}).lane_width_m
            values["sections"] = sections(profiles, width_m, with_user_data=exported)
            settings = RoadSettings.model_validate(values)
            Road(settings)
        except ValidationError as error:
            problem = error.errors()[0]
            field = ".".join(map(str, problem["loc"]))
            raise self._road.error(f"{field}: {problem['msg'].removeprefix('Value error, ')}") from error
        except ValueError as error:
            raise self._road.error(str(error)) from error
        return settings

    def _notes(self) -> tuple[str, ...]:
        notes = []
        for profile, kind, what in (
            ("elevation", "elevation", "elevation"),
            ("lateral", "superelevation", "bank"),
        ):
            found = self._road.all(f"{profile}Profile/{kind}")
            if any(element.number(name) for element in found for name in "abcd"):
                notes.append(f"{what} is left out: Trepid's roads are flat")
        for kind in ("object", "signal"):
            if found := self._road.all(f"{kind}s/{kind}"):
                notes.append(f"left out: {len(found)} {kind}s")
        return tuple(notes)


def _turned(segment: Segment) -> Segment:
    return clothoid(segment.length_m, -segment.end_curvature_1pm, -segment.start_curvature_1pm)


def _merged(fitted: list[list[Segment]]) -> tuple[Segment, ...]:
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
