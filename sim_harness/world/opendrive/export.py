"""Writes roads as OpenDRIVE 1.7 (.xodr) with scenariogeneration.

The reference line is the centre of the kept lane, so no geometry is converted: a <laneOffset> of half its width
puts the road's centre line (lane 0) on its left edge, and the kept lane is lane -1 of a road with right-hand
traffic. Heights and banks are <elevation> and <superelevation> as they are. Attributes that OpenDRIVE cannot
express (surface, wear, light, marks, junctions…) are written to <userData code="trepid">.

ASAM OpenDRIVE 1.7.0, chapters 7 (geometry), 8.4 and 8.5.1 (elevation), 9 (lanes) and 9.6 (road markings).
"""

import json
import math
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

from sim_harness.world.opendrive.sections import (
    STROKE_NAMES,
    USER_DATA,
    CrossSection,
    Ends,
    Strip,
    cross_section,
    flip_marking,
)
from sim_harness.world.roads.appearance import Marking, Paint, Section, Stroke
from sim_harness.world.roads.road import Road, RoadSettings
from trepid.config import InputError

try:
    from scenariogeneration import xodr
except ImportError as missing:
    raise InputError("scenariogeneration is not installed: pip install 'trepid[roads]'") from missing


def write_opendrive(settings: RoadSettings, path: Path) -> None:
    """Write ``settings`` to ``path``. Raises InputError when it cannot be written."""
    road = xodr.Road(1, _plan_view(settings), _lanes(settings), name=settings.name)
    if settings.closed:
        road.add_predecessor(xodr.ElementType.road, 1, xodr.ContactPoint.end)
        road.add_successor(xodr.ElementType.road, 1, xodr.ContactPoint.start)
    line = Road(settings)
    for record in line.elevation.records_from_start if line.elevation else ():
        road.add_elevation(*record)
    for record in line.bank.records_from_start if line.bank else ():
        road.add_superelevation(*record)
    in_elements = {"segments", "sections", "elevation", "bank"}
    own = settings.model_dump(mode="json", exclude=in_elements, exclude_defaults=True)
    road.add_userdata(xodr.UserData(USER_DATA, json.dumps(own)))
    file = xodr.OpenDrive(settings.name, revMajor="1", revMinor="7")
    file.add_road(road)
    root = file.get_element()
    root.find("header").set("date", "2000-01-01T00:00:00")  # equal roads give equal files
    for parent in list(root.iter()):  # the schema requires <userData> behind its siblings
        parent[:] = sorted(parent, key=lambda child: child.tag == "userData")
    ET.indent(root)
    try:
        ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _plan_view(settings: RoadSettings) -> xodr.PlanView:
    view, line = xodr.PlanView(), Road(settings)
    start_m = 0.0
    for number, segment in enumerate(settings.segments):
        x, y, heading, _ = line.poses([start_m])[0]
        first, last, length_m = segment.start_curvature_1pm, segment.end_curvature_1pm, segment.length_m
        if first != last:
            shape = xodr.Spiral(first, last, length=length_m)
        else:
            shape = xodr.Arc(first, length=length_m) if first else xodr.Line(length_m)
        view.add_fixed_geometry(shape, float(x), float(y), float(heading), s=start_m)
        start_m = math.fsum(s.length_m for s in settings.segments[: number + 1])
    return view


def _lanes(settings: RoadSettings) -> xodr.Lanes:
    lanes = xodr.Lanes()
    length_m = math.fsum(segment.length_m for segment in settings.segments)
    starts_m = [section.start_m for section in settings.sections] + [length_m]
    for section, (start_m, end_m) in zip(settings.sections, pairwise(starts_m), strict=True):
        profile = cross_section(section, settings.lane_width_m)
        a, b = _linear(profile.width_m, end_m - start_m)
        lanes.add_laneoffset(xodr.LaneOffset(start_m, a / 2, b / 2))
        lanes.add_lanesection(_lane_section(section, profile, start_m, end_m - start_m))
    _link(lanes.lanesections)
    return lanes


def _link(sections: list[xodr.LaneSection]) -> None:
    """Link each lane to the lane of the same number in the next section, where there is one."""
    for here, there in pairwise(sections):
        for before, after in ((here.leftlanes, there.leftlanes), (here.rightlanes, there.rightlanes)):
            for lane, following in zip(before, after, strict=False):
                lane.add_link("successor", following.lane_id)
                following.add_link("predecessor", lane.lane_id)


def _lane_section(
    section: Section, profile: CrossSection, start_m: float, length_m: float
) -> xodr.LaneSection:
    def lane(width_m: Ends, marking: Marking, kind: xodr.LaneType = xodr.LaneType.driving) -> xodr.Lane:
        made = xodr.Lane(kind, *_linear(width_m, length_m), 0.0, 0.0)
        made.add_roadmark(_road_mark(marking))
        return made

    centre = xodr.Lane(xodr.LaneType.none)
    centre.add_roadmark(_road_mark(profile.left))
    made = xodr.LaneSection(start_m, centre)
    nothing = Marking(stroke=Stroke.NONE)
    for strip in (Strip(profile.width_m, profile.right), *profile.right_lanes):
        made.add_right_lane(lane(strip.width_m, strip.marking))
    for strip in profile.left_lanes:  # OpenDRIVE names its lines from the inside outwards: from right to left
        made.add_left_lane(lane(strip.width_m, flip_marking(strip.marking)))
    if profile.paved_right_m:
        made.add_right_lane(lane((profile.paved_right_m,) * 2, nothing, xodr.LaneType.shoulder))
    if profile.paved_left_m:
        made.add_left_lane(lane((profile.paved_left_m,) * 2, nothing, xodr.LaneType.shoulder))
    own = section.model_dump(mode="json", exclude={"start_m"}, exclude_defaults=True)
    made.add_userdata(xodr.UserData(USER_DATA, json.dumps(own)))
    return made


def _linear(width_m: Ends, length_m: float) -> Ends:
    """Coefficients of a + b·ds."""
    return width_m[0], (width_m[1] - width_m[0]) / length_m


def _road_mark(marking: Marking) -> xodr.RoadMark:
    parts = STROKE_NAMES[marking.stroke].split()
    kind = xodr.RoadMarkType["_".join(parts)]
    if marking.stroke == Stroke.NONE:
        return xodr.RoadMark(kind)
    black = marking.paint is Paint.BLACK  # which the standard does not name
    colour = xodr.RoadMarkColor["standard" if black else marking.paint.value]
    apart_m = (marking.width_m + marking.spacing_m) / 2 if len(parts) == 2 else 0.0
    total_m = 2 * apart_m + marking.width_m
    mark = xodr.RoadMark(kind, width=total_m, color=colour)
    for part, side in zip(parts, (1, -1), strict=False):
        length_m, space_m = (marking.dash_m, marking.gap_m) if part == "broken" else (1.0, 0.0)
        line = xodr.RoadLine(marking.width_m, length_m, space_m, side * apart_m, color=colour)
        mark.add_specific_road_line(line)
    return mark
