"""OpenDRIVE: exported files are valid and read back unchanged, also by another reader; bad files are refused."""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from sim_harness.report.road_cli import app
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.opendrive.export import write_opendrive
from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Marking, NeighbourLane, Paint, Section, Stroke, Surface
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.config import CONFIG_DIR, InputError

NAMES = sorted(path.stem for path in (CONFIG_DIR / "roads").glob("*.yaml"))
PLACE = re.compile(r"\.xodr:\d+:\d+: ")


def export_road(road: RoadSettings, folder: Path) -> Path:
    path = folder / "road.xodr"
    write_opendrive(road, path)
    return path


def bare(road: RoadSettings) -> RoadSettings:
    """The road without its reference line and its profiles."""
    return road.model_copy(update={"segments": (), "elevation": (), "bank": ()})


def rise_m(a: RoadSettings, b: RoadSettings) -> float:
    """Largest difference of height at the middle and 2 m beside it."""
    road_a, road_b = Road(a), Road(b)
    stations = np.linspace(0, road_a.length_m, 700)
    sides = (road_a.heights_at(stations, t) - road_b.heights_at(stations, t) for t in (-2.0, 0.0, 2.0))
    return max(float(np.abs(side).max()) for side in sides)


def gap_m(a: RoadSettings, b: RoadSettings) -> float:
    """Largest distance between points of the same station."""
    road_a, road_b = Road(a), Road(b)
    assert road_a.length_m == pytest.approx(road_b.length_m, abs=1e-9)
    stations = np.linspace(0, road_a.length_m, 3000)
    return float(np.hypot(*(road_a.poses(stations) - road_b.poses(stations))[:, :2].T).max())


# Round trips.


@pytest.mark.parametrize("name", NAMES)
def test_export_and_import_return_every_shipped_road_unchanged(name, tmp_path):
    road = load_road(name).settings
    back = read_opendrive(export_road(road, tmp_path)).settings
    assert bare(back) == bare(road)
    assert gap_m(back, road) < 1e-6
    assert rise_m(back, road) < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_every_export_follows_the_schema(name, tmp_path):
    schemas = pytest.importorskip("schemas", reason="the OpenDRIVE schema comes with scenariogeneration")
    from lxml import etree

    schema = etree.XMLSchema(etree.parse(str(Path(schemas.__path__[0]) / "opendrive_17_core.xsd")))
    schema.assertValid(etree.parse(str(export_road(load_road(name).settings, tmp_path))))


@pytest.mark.parametrize("name", NAMES)
def test_another_reader_finds_the_same_lane(name, tmp_path):
    network = pytest.importorskip("pyxodr.road_objects.network")
    road = load_road(name)
    found = network.RoadNetwork(str(export_road(road.settings, tmp_path)), resolution=0.1).get_roads()[0]
    assert np.abs(road.nearest_coordinates(found.reference_line)[:, 1]).max() < 2e-4  # its chords of 0.1 m
    for section in found.lane_sections:
        (kept,) = [lane for lane in section.lanes if lane.id == -1]
        edge = road.nearest_coordinates(np.asarray(kept.boundary_line)[:, :2])
        half_m = np.array([road.width_at(station) / 2 for station in edge[:, 0]])
        sampling_m = 3 * np.abs(np.diff(half_m)).max()  # it evaluates widths at its samples, not at s
        assert np.abs(edge[:, 1] + half_m).max() < 2e-4 + sampling_m


def test_the_same_road_gives_the_same_bytes(tmp_path):
    road = load_road("town").settings
    first = export_road(road, tmp_path).read_bytes()
    assert export_road(road, tmp_path).read_bytes() == first


curvatures = st.floats(-0.08, 0.08).map(lambda k: round(k, 6))
markings = st.builds(
    Marking,
    stroke=st.sampled_from(Stroke),
    paint=st.sampled_from(Paint),
    width_m=st.sampled_from([0.1, 0.25]),
)
widths = st.sampled_from([2.5, 3.0, 3.75])
lanes = st.lists(st.builds(NeighbourLane, width_m=widths, marking=markings), max_size=2).map(tuple)


@st.composite
def roads(draw: st.DrawFn) -> RoadSettings:
    ends = draw(st.lists(curvatures, min_size=2, max_size=6))
    segments = [
        Segment(length_m=draw(st.floats(1.0, 60.0)), curvature_1pm=a if a == b else (a, b))
        for a, b in pairwise(ends)
    ]
    section = Section(
        name="only",
        start_m=0,
        left=draw(markings),
        right=draw(markings),
        left_lanes=draw(lanes),
        right_lanes=draw(lanes),
        lane_width_m=(draw(widths), draw(widths)),
        surface=draw(st.sampled_from(Surface)),
    )
    return RoadSettings(name="drawn", closed=False, lane_width_m=3.5, segments=segments, sections=(section,))


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(roads())
def test_export_and_import_return_any_road_unchanged(tmp_path, road):
    back = read_opendrive(export_road(road, tmp_path)).settings
    assert bare(back) == bare(road)
    assert gap_m(back, road) < 1e-6


# Lanes off the reference line.


def offset_lane_gap_m(road: Road, lane: Road, offset_m: float, *, backward: bool) -> float:
    """Largest distance of points at ``offset_m`` from ``road`` from the line of ``lane``."""
    points = road.positions(np.linspace(0, road.length_m, 3000), offset_m)
    points = points[::-1] if backward else points
    heading = road.heading_at(road.length_m) + math.pi if backward else road.heading_at(0.0)
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    coordinates = lane.nearest_coordinates((points - points[0]) @ turn)
    assert coordinates[-1, 0] == pytest.approx(lane.length_m, abs=1e-3)
    return float(np.abs(coordinates[:, 1]).max())


@pytest.mark.parametrize("name", ["curve", "s_bend"])
def test_the_oncoming_lane_is_parallel_within_a_millimetre(name, tmp_path):
    road = load_road(name)
    imported = read_opendrive(export_road(road.settings, tmp_path), lane=1).settings
    assert offset_lane_gap_m(road, Road(imported), 3.5, backward=True) < 1e-3


@pytest.mark.parametrize("rule", ["RHT", "LHT"])
def test_the_oncoming_lane_has_left_and_right_swapped(rule, tmp_path):
    double = Marking(stroke=Stroke.SOLID_DASHED, paint=Paint.YELLOW)
    section = Section(
        name="only",
        start_m=0,
        left=double,
        right=Marking(),
        left_lanes=(NeighbourLane(marking=Marking(stroke=Stroke.DASHED)),),
        paved_left_m=1.0,
        paved_right_m=0.25,
    )
    road = RoadSettings(
        name="two", closed=False, lane_width_m=3.5, segments=(Segment(length_m=50),), sections=(section,)
    )
    path = export_road(road, tmp_path)
    path.write_text(path.read_text().replace('rule="RHT"', f'rule="{rule}"'))
    (found,) = read_opendrive(path, lane=1).settings.sections
    if rule == "LHT":  # then lane 1 runs along the reference line and lane -1 against it
        assert (found.left.stroke, found.right.stroke) == (Stroke.DASHED, Stroke.SOLID_DASHED)
        assert (found.paved_left_m, found.paved_right_m) == (1.0, 0.25)
        return
    assert (found.left.stroke, found.right.stroke) == (Stroke.DASHED_SOLID, Stroke.DASHED)
    assert found.left_lanes[0].marking.stroke == Stroke.SOLID
    assert (found.paved_left_m, found.paved_right_m) == (0.25, 1.0)


# Files of other tools.


def file(geometry: str, tmp_path: Path, lane: str = "", offset: str = "", link: str = "") -> Path:
    width = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    path = tmp_path / "other.xodr"
    path.write_text(
        f"""<OpenDRIVE><header revMajor="1" revMinor="4"/>
        <road name="other" id="7" junction="-1">{link}
        <planView>{geometry}</planView>
        <lanes>{offset}<laneSection s="0"><center><lane id="0" type="none"/></center>
        <right><lane id="-1" type="driving">{lane or width}</lane></right></laneSection></lanes>
        </road></OpenDRIVE>"""
    )
    return path


def geometry(s: float, x: float, y: float, heading: float, length: float, shape: str) -> str:
    place = f's="{s!r}" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}"'
    return f"<geometry {place}>{shape}</geometry>"


def test_where_a_line_meets_an_arc_the_curvature_is_made_continuous_within_a_millimetre(tmp_path):
    radius = 20.0
    text = geometry(0, 5, 6, 0.3, 30.0, "<line/>")
    x, y = 5 + 30 * math.cos(0.3), 6 + 30 * math.sin(0.3)
    text += geometry(30, x, y, 0.3, 40.0, f'<arc curvature="{1 / radius}"/>')
    lane = Road(read_opendrive(file(text, tmp_path)).settings)  # 1.75 m to the right of the line
    angle = np.linspace(0, 2.0, 500)
    arc = np.column_stack(
        [30 + (radius + 1.75) * np.sin(angle), radius - (radius + 1.75) * np.cos(angle) + 1.75]
    )
    assert np.abs(lane.nearest_coordinates(arc)[:, 1]).max() < 1e-3
    assert lane.length_m == pytest.approx(30 + 2.0 * (radius + 1.75), abs=1e-3)


@pytest.mark.parametrize("kind", ["normalized", "arcLength", "poly3"])
def test_polynomials_are_followed_within_a_millimetre(kind, tmp_path):
    u, slopes = np.linspace(0, 40, 4001), np.array([0.0, 0.0, 0.004, -0.00005])
    v = np.polynomial.polynomial.polyval(u, slopes)
    length = float(np.hypot(np.diff(u), np.diff(v)).sum())
    if kind == "poly3":
        shape = "<poly3 " + " ".join(f'{n}="{c}"' for n, c in zip("abcd", slopes, strict=True)) + "/>"
    else:
        scale = 40.0 if kind == "normalized" else 40.0 / length
        parts = {f"{n}V": c * scale**i for i, (n, c) in enumerate(zip("abcd", slopes, strict=True))}
        parts |= {"aU": 0.0, "bU": scale, "cU": 0.0, "dU": 0.0}
        values = " ".join(f'{name}="{value!r}"' for name, value in parts.items())
        shape = f'<paramPoly3 pRange="{kind}" {values}/>'.replace("np.float64(", "").replace(")", "")
    offset = '<laneOffset s="0" a="1.75" b="0" c="0" d="0"/>'  # the lane's centre is the reference line
    lane = Road(read_opendrive(file(geometry(0, 0, 0, 0, length, shape), tmp_path, offset=offset)).settings)
    assert np.abs(lane.nearest_coordinates(np.column_stack([u, v]))[:, 1]).max() < 1e-3


def test_a_lane_that_widens_keeps_its_centre_and_its_width(tmp_path):
    widening = '<width sOffset="0" a="3" b="0" c="0.0012" d="-0.000016"/>'  # 3 m to 4 m over 50 m, smoothly
    path = file(geometry(0, 0, 0, 0, 50.0, "<line/>"), tmp_path, lane=widening)
    lane = Road(read_opendrive(path).settings)
    x = np.linspace(0, 50, 400)
    width = 3 + 0.0012 * x**2 - 0.000016 * x**3
    found = lane.nearest_coordinates(np.column_stack([x, 1.5 - width / 2]))
    assert np.abs(found[:, 1]).max() < 1e-3
    assert np.abs([lane.width_at(s) for s in found[:, 0]] - width).max() < 0.02


def test_a_marking_edited_by_another_tool_overrides_the_user_data(tmp_path):
    path = export_road(load_road("straight").settings, tmp_path)
    path.write_text(path.read_text().replace('type="solid"', 'type="broken"'))
    (before,), (after,) = load_road("straight").sections, read_opendrive(path).settings.sections
    assert (before.right.stroke, after.right.stroke) == (Stroke.SOLID, Stroke.DASHED)
    assert after.surface_grey == before.surface_grey


def test_a_scenario_may_drive_on_an_opendrive_road(tmp_path):
    path = export_road(load_road("curve").settings, tmp_path)
    scenario = Scenario(description="", tags=("nominal",), road=str(path), duration_s=1)
    assert scenario.build_road().length_m == pytest.approx(load_road("curve").length_m)


# Bad files.

GOOD = geometry(0, 0, 0, 0, 50.0, "<line/>")
BAD = {
    "Opening and ending tag mismatch": "<OpenDRIVE><road></OpenDRIVE>",
    "Document is empty": "",
    "expected <OpenDRIVE>": "<OpenSCENARIO/>",
    "at least one <road>": "<OpenDRIVE/>",
    "expected a <planView>": '<OpenDRIVE><road id="1"/></OpenDRIVE>',
    "at least one <geometry>": '<OpenDRIVE><road id="1"><planView/></road></OpenDRIVE>',
    "at least one <laneSection>": f'<OpenDRIVE><road id="1"><planView>{GOOD}</planView><lanes/></road></OpenDRIVE>',
}
BAD_GEOMETRY = {
    "got <circle>": GOOD.replace("line", "circle"),
    "got nothing": GOOD.replace("<line/>", ""),
    "'curvature' is missing": GOOD.replace("line", "arc"),
    "expected a finite number": GOOD.replace('"50.0"', '"nan"'),
    "more than 0 m": GOOD.replace('"50.0"', '"-2"'),
    "the end of the previous geometry": GOOD + GOOD,
    "pRange='x'": GOOD.replace("line/", 'paramPoly3 pRange="x"/'),
    "starts 41.000 m and 0.000 rad off": GOOD + geometry(50, 90, 9, 0, 5.0, "<line/>"),
    "starts 0.000 m and 0.500 rad off": GOOD + geometry(50, 50, 0, 0.5, 5.0, "<line/>"),
    "expected at most 1": GOOD.replace("line", 'arc curvature="3"'),
}
BAD_LANE = {
    "expected a <width>": "<link/>",
    "at most 0 m wide": '<border sOffset="0" a="3.5" b="0" c="0" d="0"/>',
    "type='wavy'": '<width sOffset="0" a="3.5" b="0" c="0" d="0"/><roadMark sOffset="0" type="wavy"/>',
    "leaves the reference line": '<width sOffset="0" a="3.5" b="3" c="0" d="0"/>',
    "lane_width_m": '<width sOffset="0" a="19" b="0" c="0" d="0"/>',
    "c='1e999'": '<width sOffset="0" a="3" b="0" c="1e999" d="0"/>',
}


@pytest.mark.parametrize("reason", BAD)
def test_a_file_without_a_road_is_refused_with_its_place(reason, tmp_path):
    path = tmp_path / "bad.xodr"
    path.write_text(BAD[reason])
    with pytest.raises(InputError, match=re.escape(reason)) as error:
        read_opendrive(path)
    assert PLACE.search(str(error.value)) and "\n" not in str(error.value)


@pytest.mark.parametrize("reason", [*BAD_GEOMETRY, *BAD_LANE])
def test_a_bad_element_is_refused_with_its_place(reason, tmp_path):
    path = file(BAD_GEOMETRY.get(reason, GOOD), tmp_path, lane=BAD_LANE.get(reason, ""))
    with pytest.raises(InputError, match=re.escape(reason)) as error:
        read_opendrive(path)
    assert PLACE.search(str(error.value)) and "\n" not in str(error.value)


@pytest.mark.parametrize("namespace", ["", ' xmlns="http://example.org/xodr"'])
def test_the_place_of_an_error_is_where_the_start_tag_begins(namespace, tmp_path):
    path = tmp_path / "bad.xodr"
    path.write_text(
        f"""<?xml version="1.0"?>
<!DOCTYPE OpenDRIVE [ <!ENTITY other "<road>"> ]>
<OpenDRIVE{namespace}><!-- <road> -->
  <road
     id="1"><planView><geometry s="0"
       x="0"/></planView></road></OpenDRIVE>"""
    )
    with pytest.raises(
        InputError, match=r"bad.xodr:5:23: <geometry> of road 1, s = 0 m: attribute 'length' is missing"
    ):
        read_opendrive(path)


def test_an_unknown_lane_or_road_is_refused_with_the_known_ones(tmp_path):
    path = export_road(load_road("curve").settings, tmp_path)
    with pytest.raises(InputError, match="there are 1, -1"):
        read_opendrive(path, lane=4)
    with pytest.raises(InputError, match="no road has the id '4'; there are 1"):
        read_opendrive(path, road="4")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(tmp_path, data):
    text = export_road(load_road("curve").settings, tmp_path).read_text()
    places = [match.span(1) for match in re.finditer(r'="([^"]*)"', text)]
    start, end = data.draw(st.sampled_from(places))
    value = data.draw(
        st.sampled_from(["", "x", "-1", "0", "1e300", "-1e300", "1e-300", "7", "broken", "{}", "[]"])
    )
    path = tmp_path / "damaged.xodr"
    path.write_text(text[:start] + value + text[end:])
    try:
        read_opendrive(path)
    except InputError as error:
        assert PLACE.search(str(error)) and "\n" not in str(error)


# The verbs.


def test_the_verbs_export_and_import_return_the_road_as_yaml(tmp_path):
    xodr, yaml = tmp_path / "c.xodr", tmp_path / "c.yaml"
    for arguments in (["export", "circuit", str(xodr)], ["import", str(xodr), str(yaml)]):
        assert CliRunner().invoke(app, arguments).exit_code == 0
    assert bare(load_road(yaml).settings) == bare(load_road("circuit").settings)
    assert gap_m(load_road(yaml).settings, load_road("circuit").settings) < 1e-6


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_opendrive(load_road("curve").settings, tmp_path / "no" / "c.xodr")
    with pytest.raises(InputError, match="cannot be read"):
        read_opendrive(tmp_path / "no.xodr")
