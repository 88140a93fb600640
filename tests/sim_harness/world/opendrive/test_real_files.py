"""OpenDRIVE as editors write it: slivers, rounding, lanes that follow links, sections of one side."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.roads.lanes import RoadLane
from sim_harness.world.roads.road import Road
from trepid.config import InputError

WIDTH = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
MARK = '<roadMark sOffset="0" type="broken" width="0.12"/>'
LINE = "<line/>"


def lane(
    number: int, *, width: str = WIDTH, before: int | None = None, after: int | None = None, **also
) -> str:
    links = f'<predecessor id="{before}"/>' * (before is not None) + f'<successor id="{after}"/>' * (
        after is not None
    )
    kind = also.get("kind", "driving")
    return f'<lane id="{number}" type="{kind}" level="false"><link>{links}</link>{width}{MARK}</lane>'


def section(s: float, left: str = "", right: str = "", attributes: str = "") -> str:
    left, right = f"<left>{left}</left>" if left else "", f"<right>{right}</right>" if right else ""
    return (
        f'<laneSection s="{s!r}" {attributes}>{left}<center><lane id="0" type="none">{MARK}</lane></center>'
        f"{right}</laneSection>"
    )


def shapes(*parts: tuple[float, str], x: float = 0.0, heading: float = 0.0) -> str:
    """Geometries one after the other, each beginning where a line or arc before it ends."""
    text, s, y = "", 0.0, 0.0
    for length, shape in parts:
        text += f'<geometry s="{s!r}" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}">{shape}</geometry>'
        curvature = float(shape.split('"')[1]) if "arc" in shape else 0.0
        turned = curvature * length
        chord = length * np.sinc(turned / 2 / np.pi)
        x, y = (
            float(x + chord * math.cos(heading + turned / 2)),
            float(y + chord * math.sin(heading + turned / 2)),
        )
        s, heading = s + length, heading + turned
    return text


def road(number: str, geometry: str, sections: str, offsets: str = "") -> str:
    head = f'<road name="r{number}" id="{number}" junction="-1">'
    return f"{head}<planView>{geometry}</planView><lanes>{offsets}{sections}</lanes></road>"


def write_roads(folder: Path, *roads: str) -> Path:
    path = folder / "real.xodr"
    path.write_text('<?xml version="1.0"?>\n<OpenDRIVE>\n' + "\n".join(roads) + "\n</OpenDRIVE>")
    return path


def away_m(found: Road, truth: np.ndarray) -> float:
    """Greatest distance of the centre of ``found``, placed at the start of ``truth`` (n, 2), from its polyline."""
    step = truth[1] - truth[0]
    heading = math.atan2(step[1], step[0])
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    return float(np.abs(found.nearest_coordinates((truth - truth[0]) @ turn)[:, 1]).max())


ONE = section(0.0, right=lane(-1))
SLIVERS = [4e-6, 5e-4, 9e-3, 19e-3]


@pytest.mark.parametrize("length", SLIVERS)
@pytest.mark.parametrize(
    "shape", [LINE, '<arc curvature="0.4"/>', '<spiral curvStart="0.1" curvEnd="-0.2"/>']
)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_sliver_of_the_reference_line_belongs_to_its_neighbours(tmp_path, place, shape, length):
    bend = '<arc curvature="0.02"/>'
    parts = [(60.0, LINE), (40.0, bend)]
    parts.insert(place, (length, shape))
    text = shapes(*parts)
    found = Road(read_opendrive(write_roads(tmp_path, road("1", text, ONE))).settings)
    truth = np.vstack(
        [
            right_of(origin, size, 0.02 * (kind == bend))
            for origin, (size, kind) in zip(origins(text), parts, strict=True)
        ]
    )
    assert found.length_m == pytest.approx(60.0 + 40.0 * (1 + 0.02 * 1.75), abs=0.04)
    assert away_m(found, truth) < 0.02


def origins(text: str) -> list[tuple[float, float, float]]:
    """x, y and heading of each geometry."""
    found = re.findall(r'x="(\S+)" y="(\S+)" hdg="(\S+)"', text)
    return [(float(x), float(y), float(heading)) for x, y, heading in found]


def right_of(origin: tuple[float, float, float], length: float, curvature: float) -> np.ndarray:
    """Points 1.75 m to the right of a line or an arc of some metres; none along a sliver."""
    x, y, heading = origin
    s = np.linspace(0.0, length, 2000) if length > 1.0 else np.array([])
    turned = curvature * s
    chord = s * np.sinc(turned / 2 / np.pi)
    x, y = x + chord * np.cos(heading + turned / 2), y + chord * np.sin(heading + turned / 2)
    return np.column_stack([x + 1.75 * np.sin(heading + turned), y - 1.75 * np.cos(heading + turned)])


def test_a_geometry_without_length_is_no_error_and_a_negative_one_is(tmp_path):
    text = shapes((60.0, LINE), (0.0, '<spiral curvStart="0" curvEnd="0.1"/>'), (40.0, LINE))
    assert Road(
        read_opendrive(write_roads(tmp_path, road("1", text, ONE))).settings
    ).length_m == pytest.approx(100.0)
    with pytest.raises(InputError, match="more than 0 m"):
        read_opendrive(write_roads(tmp_path, road("1", shapes((60.0, LINE), (-1.0, LINE)), ONE)))


@pytest.mark.parametrize("s", [5e-6, 1e-3, 60.0 + 1e-5, 100.0 - 1e-6, 100.0 - 5e-3, 100.0])
def test_records_and_sections_a_sliver_apart_or_at_the_end_make_no_stretch(tmp_path, s):
    geometry = shapes((60.0, LINE), (40.0, LINE))
    offsets = f'<laneOffset s="0" a="0" b="0" c="0" d="0"/><laneOffset s="{s!r}" a="0" b="0" c="0" d="0"/>'
    twice = ONE + section(s, right=lane(-1, before=-1))
    widths = lane(-1, width=WIDTH + WIDTH.replace('sOffset="0"', f'sOffset="{s!r}"'))
    for text in (
        road("1", geometry, ONE, offsets),
        road("1", geometry, twice),
        road("1", geometry, section(0.0, right=widths)),
    ):
        found = Road(read_opendrive(write_roads(tmp_path, text)).settings)
        assert found.length_m == pytest.approx(100.0, abs=1e-6)
        assert len(found.settings.segments) == 1


def taper(end_m: float) -> str:
    """A width from 3.5 m to ``end_m`` over 100 m, by a cubic that is flat at both ends."""
    fall = end_m - 3.5
    return f'<width sOffset="0" a="3.5" b="0" c="{3 * fall / 1e4!r}" d="{-2 * fall / 1e6!r}"/>'


@pytest.mark.parametrize("end_m", [0.0, -8.9e-16, -5e-4])
def test_a_width_below_zero_by_rounding_is_zero(tmp_path, end_m):
    lanes = lane(-1) + lane(-2, width=taper(end_m))
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), section(0.0, right=lanes))))
    last = found.settings.sections[-1].right_lanes[0].width_m
    assert last[1] == pytest.approx(0.0, abs=1e-9)


def test_a_negative_width_is_refused_with_road_lane_and_station(tmp_path):
    lanes = lane(-1) + lane(-2, width=taper(-0.01))
    path = write_roads(tmp_path, road("8", shapes((100.0, LINE)), section(0.0, right=lanes)))
    with pytest.raises(InputError) as refused:
        read_opendrive(path)
    assert str(refused.value).startswith(f"{path}:3:")
    assert "<lane> of road 8, lane -2, s = 0.0 m: its width is -0.01 m at s = 99.98 m" in str(refused.value)


@pytest.mark.parametrize("jump_m", [1.3e-7, -1.3e-7, 4e-4])
def test_widths_that_differ_by_rounding_at_a_joint_are_joined(tmp_path, jump_m):
    after = WIDTH.replace("3.5", repr(3.5 + jump_m))
    slope = '<width sOffset="0" a="3.4" b="0.0020000013" c="0" d="0"/>'
    for first in (WIDTH, slope):
        two = section(0.0, right=lane(-1, width=first, after=-1) + lane(-2, width=first, after=-2))
        two += section(50.0, right=lane(-1, width=after, before=-1) + lane(-2, width=after, before=-2))
        found = read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), two)), lane=-1)
        assert Road(found.settings).width_at(75.0) == pytest.approx(3.5, abs=1e-3)


OPENING = '<width sOffset="0" a="0" b="0" c="0.0042" d="-0.000056"/>'  # to 3.5 m over 50 m
CLOSING = '<width sOffset="0" a="3.5" b="0" c="-0.0042" d="0.000056"/>'


def two_plus_one() -> str:
    """An overtaking lane opens on the right of the centre line at 100 m, and closes from 200 m on."""
    oncoming, plain = lane(1), section
    sections = plain(0.0, oncoming, lane(-1, after=-2))
    sections += plain(100.0, oncoming, lane(-1, width=OPENING, after=-1) + lane(-2, before=-1, after=-2))
    sections += plain(150.0, oncoming, lane(-1, before=-1, after=-1) + lane(-2, before=-2, after=-2))
    sections += plain(200.0, oncoming, lane(-1, width=CLOSING, before=-1) + lane(-2, before=-2, after=-1))
    return sections + plain(250.0, oncoming, lane(-1, before=-2))


def test_where_a_lane_opens_between_two_the_outer_one_stays_where_it_is(tmp_path):
    """The line between the directions is the reference line: the oncoming lane never moves."""
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((300.0, LINE)), two_plus_one())), lane=-1)
    kept = Road(found.settings)
    counts = [len([one for one in part.left_lanes if one.width_m]) for part in found.settings.sections]
    assert counts[0] == counts[-1] == 1 and max(counts) == 2
    for index, station in ((1, 50.0), (2, 175.0), (1, kept.length_m - 25.0)):
        oncoming = RoadLane(kept, index)
        at = oncoming.position(station, 0.0)
        left_m = at[1] - kept.position(0.0, 0.0)[1]
        assert left_m == pytest.approx(3.5, abs=0.02)
        assert oncoming.width_at(station) == pytest.approx(3.5, abs=1e-6)


def test_against_the_reference_line_the_same_road_has_the_same_lanes(tmp_path):
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((300.0, LINE)), two_plus_one())), lane=1)
    kept = Road(found.settings)
    assert (kept.length_m, len(found.settings.segments)) == (pytest.approx(300.0), 1)
    assert RoadLane(kept, 2).centre_at(125.0) == pytest.approx(7.0)
    assert [round(RoadLane(kept, 1).width_at(s), 2) for s in (25.0, 125.0, 275.0)] == [3.5, 3.5, 3.5]


def test_a_lane_that_only_its_successor_links_is_followed(tmp_path):
    both = section(0.0, right=lane(-1)) + section(50.0, right=lane(-1, width=OPENING) + lane(-2, before=-1))
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), both)), lane=-1)
    kept = Road(found.settings)
    assert found.notes == ()
    assert kept.position(kept.length_m, 0.0)[1] == pytest.approx(-3.5, abs=0.02)


def test_lanes_that_end_and_open_at_full_width_on_one_side_are_imported(tmp_path):
    wide = WIDTH.replace("3.5", "3.0")
    first = lane(-1, after=-1) + lane(-2)
    second = lane(-1, before=-1) + lane(-2, width=wide, before=7) + lane(-3, width=wide, before=7)
    both = section(0.0, right=first) + section(50.0, right=second)
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), both)))
    assert [len(part.right_lanes) for part in found.settings.sections] == [1, 2]


def test_a_road_ends_where_its_lane_ends_or_is_too_narrow_and_a_note_says_so(tmp_path):
    ends = section(0.0, right=lane(-1, after=-1) + lane(-2)) + section(60.0, right=lane(-1, before=-1))
    path = write_roads(tmp_path, road("1", shapes((100.0, LINE)), ends))
    found = read_opendrive(path, lane=-2)
    assert Road(found.settings).length_m == pytest.approx(60.0)
    assert found.notes == ("lane -2 ends at s = 60 m of 100 m",)
    narrowing = road("1", shapes((100.0, LINE)), section(0.0, right=lane(-1, width=taper(0.0))))
    found = read_opendrive(write_roads(tmp_path, narrowing))
    assert 40.0 < Road(found.settings).length_m < 70.0
    assert "too narrow outside s = 0.0 to" in found.notes[0]


def test_a_lane_whose_link_names_a_lane_that_is_not_there_is_refused(tmp_path):
    wrong = section(0.0, right=lane(-1, after=-3)) + section(60.0, right=lane(-1))
    path = write_roads(tmp_path, road("4", shapes((100.0, LINE)), wrong))
    with pytest.raises(
        InputError, match=r"<laneSection> of road 4, s = 60.0 m: lane -1 ends here: .* a lane -3"
    ):
        read_opendrive(path)


@pytest.mark.parametrize("kept", [-1, 1])
def test_a_section_of_a_single_side_leaves_the_other_side_as_it_was(tmp_path, kept):
    """The other side goes on with its own widths: one that grows from 3 m at 0 m by 1 cm/m does so beyond 50 m."""
    grows = '<width sOffset="0" a="3" b="0.01" c="0" d="0"/>'
    both = section(0.0, lane(1, after=1), lane(-1, width=grows))
    both += section(50.0, left=lane(1, before=1) + lane(2), attributes='singleSide="true"')
    found = read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), both)), lane=kept)
    kept_road = Road(found.settings)
    right = RoadLane(kept_road, 0 if kept == -1 else 1)
    for s in (20.0, 80.0):
        assert right.width_at(s if kept == -1 else kept_road.length_m - s) == pytest.approx(
            3 + 0.01 * s, abs=1e-3
        )
    beyond = found.settings.sections[-1].left_lanes if kept == -1 else found.settings.sections[0].right_lanes
    assert len(beyond) == (2 if kept == -1 else 1)


def test_roads_that_are_not_asked_for_are_not_judged(tmp_path):
    broken = '<road name="b"><planView><geometry s="x"/></planView></road>'
    walk = road("2", shapes((100.0, LINE)), section(0.0, right=lane(-1, kind="sidewalk")))
    good = road("3", shapes((80.0, LINE)), ONE)
    path = write_roads(tmp_path, broken, walk, good)
    for asked in ("3", None):
        assert Road(read_opendrive(path, road=asked).settings).length_m == pytest.approx(80.0)
    with pytest.raises(InputError, match=r"road 2, s = 0\.0 m: expected a lane of type driving"):
        read_opendrive(path, road="2")


def test_a_lane_tighter_than_any_road_is_refused_with_its_radius(tmp_path):
    bend = shapes((20.0, LINE), (3.0, '<arc curvature="-0.45"/>'), (20.0, LINE))
    path = write_roads(tmp_path, road("6", bend, ONE))
    with pytest.raises(InputError, match=r"road 6, s = 20.0 m: lane -1: the lane bends with R = 0.4"):
        read_opendrive(path)


def test_a_polynomial_whose_parameter_is_not_its_length_carries_a_lane_that_widens(tmp_path):
    """x = 40p + 20p², y = 10p³ over a nominal length: widths count by the parameter, as tools write them."""
    p = np.linspace(0.0, 1.0, 20001)
    x, y = 40 * p + 20 * p**2, 10 * p**3
    length = float(np.hypot(np.diff(x), np.diff(y)).sum())
    cubic = '<paramPoly3 aU="0" bU="40" cU="20" dU="0" aV="0" bV="0" cV="0" dV="10" pRange="normalized"/>'
    grows = f'<width sOffset="0" a="3" b="{1 / length!r}" c="0" d="0"/>'
    text = road("1", shapes((length, cubic)), section(0.0, right=lane(-1, width=grows)))
    heading = np.arctan2(30 * p**2, 40 + 40 * p)
    offset = -(3 + p) / 2
    centre = np.column_stack([x - offset * np.sin(heading), y + offset * np.cos(heading)])
    assert away_m(Road(read_opendrive(write_roads(tmp_path, text)).settings), centre) < 5e-3


def cubic(tag: str, *records: tuple[float, float, float, float, float]) -> str:
    return "".join(
        f'<{tag} sOffset="{s!r}" a="{a!r}" b="{b!r}" c="{c!r}" d="{d!r}"/>' for s, a, b, c, d in records
    )


FLARE = (0.0, -3.5, 0.0, -0.02625, 8.75e-4), (20.0, -7.0, 0.0, 0.0, 0.0)


def test_borders_give_the_same_road_as_the_widths_between_them(tmp_path):
    borders = [cubic("border", (0.0, sign * 3.5, sign * 0.002, 0.0, 0.0)) for sign in (1, -1)]
    outer = cubic(
        "border", *((s, a, b - 0.002, c, d) for s, a, b, c, d in FLARE[:1]), (20.0, -7.04, -0.002, 0.0, 0.0)
    )
    widths = cubic("width", (0.0, 3.5, 0.002, 0.0, 0.0))
    grown = cubic("width", (0.0, 0.0, 0.0, 0.02625, -8.75e-4), (20.0, 3.5, 0.0, 0.0, 0.0))
    geometry = shapes((100.0, '<arc curvature="0.01"/>'))
    found = []
    for left, inner, far in ((borders[0], borders[1], outer), (widths, widths, grown)):
        right = lane(-1, width=inner) + lane(-2, width=far)
        found.append(write_roads(tmp_path, road("1", geometry, section(0.0, lane(1, width=left), right))))
        found[-1] = read_opendrive(found[-1]).settings
    by_borders, by_widths = Road(found[0]), Road(found[1])
    assert by_borders.length_m == pytest.approx(by_widths.length_m, abs=1e-6)
    for s in np.linspace(0.5, by_widths.length_m - 0.5, 40):
        assert by_borders.width_at(s) == pytest.approx(by_widths.width_at(s), abs=1e-6)
    ends = [
        [(*one.lane_width_m, *one.right_lanes[0].width_m) for one in each.sections[1:6]] for each in found
    ]
    assert np.allclose(*ends, atol=1e-6)


def test_a_border_without_lanes_inside_is_the_width(tmp_path):
    right = lane(-1, width=cubic("border", (0.0, -3.25, 0.0, 0.0, 0.0)))
    path = write_roads(tmp_path, road("1", shapes((80.0, LINE)), section(0.0, right=right)))
    assert read_opendrive(path).settings.lane_width_m == 3.25


def test_of_a_lane_with_widths_and_borders_the_widths_count(tmp_path):
    both = WIDTH + cubic("border", (0.0, -9.0, 0.0, 0.0, 0.0))
    path = write_roads(tmp_path, road("1", shapes((80.0, LINE)), section(0.0, right=lane(-1, width=both))))
    assert read_opendrive(path).settings.lane_width_m == 3.5


def test_borders_in_a_road_with_a_lane_offset_are_refused(tmp_path):
    right = lane(-1, width=cubic("border", (0.0, -3.25, 0.0, 0.0, 0.0)))
    for a, refused in ((0.0, False), (1.25, True)):
        offset = f'<laneOffset s="0" a="{a}" b="0" c="0" d="0"/>'
        path = write_roads(tmp_path, road("1", shapes((80.0, LINE)), section(0.0, right=right), offset))
        if refused:
            with pytest.raises(
                InputError, match="<laneOffset> of road 1, s = 0 m: a lane offset other than 0"
            ):
                read_opendrive(path)
        else:
            assert read_opendrive(path).settings.lane_width_m == 3.25


@pytest.mark.parametrize("width_m", [6.5, 9.0, 14.0])
def test_a_lane_wider_than_those_of_cars_is_imported_and_driven_in_its_middle(tmp_path, width_m):
    right = lane(-1, width=cubic("width", (0.0, width_m, 0.0, 0.0, 0.0)))
    path = write_roads(tmp_path, road("1", shapes((80.0, LINE)), section(0.0, right=right)))
    found = Road(read_opendrive(path).settings)
    assert found.width_at(40.0) == width_m
    assert found.length_m == 80.0


def straight(folder, right, left=""):
    return write_roads(folder, road("1", shapes((80.0, LINE)), section(0.0, left, right)))


def flat(width_m: float) -> str:
    return cubic("width", (0.0, width_m, 0.0, 0.0, 0.0))


def test_without_a_lane_given_one_that_is_nowhere_wide_is_passed_over(tmp_path):
    path = straight(
        tmp_path, lane(-1, width=flat(0.0)) + lane(-2, width=flat(3.25)), lane(1, width=flat(3.0))
    )
    assert read_opendrive(path).settings.lane_width_m == 3.25
    with pytest.raises(InputError, match=r"lane -1.*at most 0 m wide"):
        read_opendrive(path, lane=-1)


def test_a_lane_that_is_there_twice_is_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"<lane> of road 1, lane -1, s = 0.0 m: id=-1: this section has such a lane"
    ):
        read_opendrive(straight(tmp_path, lane(-1) + lane(-1)))


def test_a_road_whose_id_another_has_is_refused_when_it_is_asked_for(tmp_path):
    one = road("1", shapes((80.0, LINE)), ONE)
    path = write_roads(
        tmp_path, one, road("1", shapes((50.0, LINE)), ONE), road("2", shapes((30.0, LINE)), ONE)
    )
    with pytest.raises(InputError, match="<road> of road 1: 2 roads have the id '1'"):
        read_opendrive(path, road="1")
    assert Road(read_opendrive(path, road="2").settings).length_m == 30.0


def test_a_lane_whose_middle_jumps_is_refused_with_the_jump(tmp_path):
    step = cubic("width", (0.0, 3.5, 0.0, 0.0, 0.0), (40.0, 3.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"lane -1.*the middle of this lane jumps by 0\.25 m at s = 40 m"):
        read_opendrive(straight(tmp_path, lane(-1, width=step)))


def test_a_stated_length_that_the_geometries_do_not_have_is_a_note(tmp_path):
    path = straight(tmp_path, lane(-1))
    whole = path.read_text()
    path.write_text(whole.replace("<road ", '<road length="120" '))
    assert "length=120: its geometries are 80 m long" in read_opendrive(path).notes
    path.write_text(whole.replace("<road ", '<road length="80.0000004" '))
    assert not [note for note in read_opendrive(path).notes if "length" in note]


SHIFT = '<laneOffset s="{}" a="{}" b="0" c="0" d="0"/>'


@pytest.mark.parametrize("first", ["permanent", "temporary"])
def test_lanes_of_roadworks_beside_those_of_the_road_change_nothing(tmp_path, first):
    """Version 1.9: one <lanes> a layer, and one link a layer."""
    link = '<link><successor id="-2" layer="temporary"/><successor id="-1" layer="permanent"/></link>'
    before = section(0.0, right=lane(-1).replace("<link></link>", link))
    after = section(50.0, right=lane(-1) + lane(-2))
    closed = section(40.0, right=lane(-1, kind="median"))
    layers = {
        "permanent": f'<lanes layer="permanent">{SHIFT.format(0, 0)}{SHIFT.format(50, 0)}{before}{after}</lanes>',
        "temporary": f'<lanes layer="temporary">{SHIFT.format(40, 0.5)}{closed}</lanes>',
    }
    both = "".join(layers[name] for name in sorted(layers, reverse=first == "temporary"))
    head = f'<road id="1" junction="-1"><planView>{shapes((100.0, LINE))}</planView>'
    settings = read_opendrive(write_roads(tmp_path, f"{head}{both}</road>")).settings
    assert Road(settings).length_m == pytest.approx(100.0)
    assert settings.lane_width_m == pytest.approx(3.5)


def test_a_geometry_shorter_than_nothing_by_rounding_is_none(tmp_path):
    geometry = shapes((100.0, LINE)) + shapes((-1.4e-14, LINE), x=100.0).replace('s="0.0"', 's="100.0"')
    found = read_opendrive(write_roads(tmp_path, road("1", geometry, ONE)))
    assert Road(found.settings).length_m == pytest.approx(100.0)


def test_a_marking_without_a_place_is_that_of_the_whole_lane(tmp_path):
    marked = write_roads(tmp_path, road("1", shapes((100.0, LINE)), ONE))
    with_place = read_opendrive(marked).settings
    marked.write_text(marked.read_text().replace('<roadMark sOffset="0"', "<roadMark"))
    assert read_opendrive(marked).settings == with_place


@pytest.mark.parametrize("opens_m", [200.0, 50.0])
def test_the_middle_of_a_lane_beside_one_that_opens_in_a_straight_line_is_followed(tmp_path, opens_m):
    """3.5 m wider, linearly, as hand-written files and some editors have it: the middle turns aside at an angle."""
    opening = cubic("width", (0.0, 0.0, 3.5 / opens_m, 0.0, 0.0))
    after = lane(-1, width=opening) + lane(-2, before=-1)
    geometry = shapes((60.0 + opens_m, LINE))
    path = write_roads(
        tmp_path, road("1", geometry, section(0.0, right=lane(-1)) + section(60.0, right=after))
    )
    found = Road(read_opendrive(path).settings)
    s = np.linspace(0.0, 60.0 + opens_m, 4000)
    truth = np.column_stack([s, -1.75 - np.maximum(s - 60.0, 0.0) * 3.5 / opens_m])
    assert found.length_m == pytest.approx(60.0 + math.hypot(opens_m, 3.5), abs=0.01)
    assert away_m(found, truth) < 0.01


def test_a_lane_beyond_a_strip_of_grass_may_be_narrower_than_nothing(tmp_path):
    broken = lane(2, width=cubic("width", (0.0, 3.5, -0.05, 0.0, 0.0)))
    path = straight(tmp_path, lane(-1), lane(1, kind="none") + broken)
    assert Road(read_opendrive(path).settings).length_m == pytest.approx(80.0)
    with pytest.raises(InputError, match=r"lane 2.*: its width is -0\.49"):
        read_opendrive(straight(tmp_path, lane(-1), lane(1, kind="median") + broken))


@pytest.mark.parametrize("kind", ["shoulder", "driving"])
@pytest.mark.parametrize("width", ["", '<width sOffset="20" a="2" b="0" c="0" d="0"/>'])
def test_beside_the_kept_lane_one_without_a_width_ends_the_carriageway_and_a_note_says_so(
    tmp_path, kind, width
):
    known = lane(-1) + lane(-2, kind="shoulder", width=flat(1.5))
    unknown = lane(-3, kind=kind, width=width)
    found = read_opendrive(straight(tmp_path, known + unknown + lane(-4, kind="shoulder"), lane(1)))
    assert found.settings == read_opendrive(straight(tmp_path, known, lane(1))).settings
    assert found.settings.sections[0].paved_right_m == 1.5
    assert found.notes == ("lane -3 has no width from s = 0 m on: it and what lies beyond are left out",)
    across = read_opendrive(straight(tmp_path, known, lane(1, kind=kind, width=width) + lane(2)))
    assert not across.settings.sections[0].left_lanes and "lane 1 has no width" in across.notes[0]


@pytest.mark.parametrize("number", [-1, -2])
def test_a_lane_without_a_width_is_refused_where_the_place_of_the_kept_one_rests_on_it(tmp_path, number):
    lanes = [lane(n, width="" if n == number else WIDTH) for n in (-1, -2)]
    path = straight(tmp_path, "".join(lanes))
    with pytest.raises(
        InputError, match=rf"\.xodr:\d+:\d+: <lane> of road 1, lane {number}, .*expected a <width>"
    ):
        read_opendrive(path, lane=-2)


STRAIGHT = road("1", shapes((100.0, LINE)), ONE)
ODD_TEXTS = {
    "an element of another tool in a geometry": lambda text: text.replace(
        "<line/>", "<line/><scene id='1'/>"
    ).encode(),
    "other letters": lambda text: (
        text.replace("driving", "Driving")
        .replace('"broken"', '"Broken"')
        .replace("<road ", '<road rule="rht" ')
        .encode()
    ),
    "an empty link": lambda text: text.replace(
        "<link></link>", "<link><predecessor/><successor/></link>"
    ).encode(),
    "blank lines above the declaration": lambda text: b"\n \n" + text.encode(),
    "the code page of Windows called UTF-8": lambda text: (
        text.replace('<?xml version="1.0"?>', '<?xml version="1.0" encoding="UTF-8"?>')
        .replace("<OpenDRIVE>", "<OpenDRIVE><!-- größer – gemessen -->")
        .encode("cp1252")
    ),
    "a declared code page": lambda text: (
        text.replace('"1.0"?', '"1.0" encoding="windows-1252"?')
        .replace("<OpenDRIVE>", "<OpenDRIVE><!-- größer – gemessen -->")
        .encode("cp1252")
    ),
}


@pytest.mark.parametrize("odd", ODD_TEXTS)
def test_a_road_means_the_same_however_its_text_is_written(tmp_path, odd):
    path = write_roads(tmp_path, STRAIGHT)
    plain, text = read_opendrive(path), path.read_text()
    data = ODD_TEXTS[odd](text)
    assert data != text.encode()
    path.write_bytes(data)
    assert read_opendrive(path) == plain


def test_an_error_below_blank_lines_above_the_declaration_has_its_line(tmp_path):
    path = write_roads(tmp_path, STRAIGHT)
    path.write_text("\n\n" + path.read_text().replace('a="3.5"', 'a="x"', 1))
    with pytest.raises(InputError, match=r"real\.xodr:5:\d+: <width>"):
        read_opendrive(path)


@pytest.mark.parametrize("name", ["normalized", "Normalized"])
def test_the_range_of_a_curve_is_read_in_capitals_too(tmp_path, name):
    curve = '<paramPoly3 aU="0" bU="80" cU="0" dU="0" aV="0" bV="0" cV="6" dV="0" pRange="{}"/>'
    found = [
        read_opendrive(write_roads(tmp_path, road("1", shapes((80.6, curve.format(each))), ONE))).settings
        for each in ("normalized", name)
    ]
    assert found[0] == found[1]


def test_a_link_to_the_centre_is_refused(tmp_path):
    sections = section(0.0, right=lane(-1, after=0)) + section(50.0, right=lane(-1))
    with pytest.raises(InputError, match="lane -1 ends here: expected a lane 0"):
        read_opendrive(write_roads(tmp_path, road("1", shapes((100.0, LINE)), sections)))
