"""Heights and banks of OpenDRIVE: the lane lies where a direct evaluation of the file puts it."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sim_harness.world.opendrive.export import write_opendrive
from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint
from sim_harness.world.roads.road import Road
from trepid.config import InputError

ARC_M, RADIUS_M = 120.0, 60.0
HILL = ((0.0, (212.0, 0.02, 0.0004, 0.0)), (50.0, (214.0, 0.06, -0.001, 4e-6)))
LEAN = ((0.0, (0.0, 0.001, 0.0, 0.0)), (60.0, (0.06, 0.001, -2e-5, 0.0)))


def tags(name: str, records) -> str:
    fields = ((s, *abcd) for s, abcd in records)
    return "".join(f'<{name} s="{s}" a="{a}" b="{b}" c="{c}" d="{d}"/>' for s, a, b, c, d in fields)


def file(folder: Path, hill: str = "", lean: str = "") -> Path:
    """A bend to the left with a lane on either side."""
    bend = f'<arc curvature="{1 / RADIUS_M}"/>'
    lane = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
    path = folder / "hill.xodr"
    path.write_text(
        f"""<OpenDRIVE><header revMajor="1" revMinor="7"/><road name="hill" id="7" junction="-1">
<planView><geometry s="0" x="0" y="0" hdg="0" length="{ARC_M}">{bend}</geometry></planView>
<elevationProfile>{hill}</elevationProfile>
<lateralProfile>{lean}</lateralProfile>
<lanes><laneSection s="0"><left>{lane.format(1)}</left><center><lane id="0" type="none"/></center>
<right>{lane.format(-1)}</right></laneSection></lanes></road></OpenDRIVE>"""
    )
    return path


def evaluate(records, s: float) -> float:
    start, coefficients = [record for record in records if record[0] <= s][-1]
    return float(np.polynomial.polynomial.polyval(s - start, coefficients))


@pytest.mark.parametrize("lane", [-1, 1])
def test_the_lane_lies_and_leans_as_the_polynomials_of_the_file_say(lane, tmp_path):
    read = read_opendrive(file(tmp_path, tags("elevation", HILL), tags("superelevation", LEAN)), lane=lane)
    road, t = Road(read.settings), 1.75 * lane
    for s in np.linspace(1.0, ARC_M - 1.0, 60):
        if min(abs(s - 50), abs(s - 60)) < 1:
            continue  # where slopes jump they are rounded off
        way = s * (1 - t / RADIUS_M)
        station = way if lane < 0 else road.length_m - way
        expected_m = evaluate(HILL, s) + t * math.tan(evaluate(LEAN, s))
        assert road.heights_at(station) == pytest.approx(expected_m, abs=2e-3)
        assert road.bank_at(station) == pytest.approx(-lane * evaluate(LEAN, s), abs=1e-3)
        rise_m = road.heights_at(station + 0.01) - road.heights_at(station - 0.01)
        assert road.grade_at(station) == pytest.approx(rise_m / 0.02, abs=1e-6)


def test_a_jump_of_the_grade_is_rounded_off_over_a_metre_and_noted(tmp_path):
    kink = ((0.0, (0.0, 0.05, 0.0, 0.0)), (50.0, (2.5, -0.05, 0.0, 0.0)))
    read = read_opendrive(file(tmp_path, tags("elevation", kink)))
    assert read.notes == ("the grade or the bank jumps at 1 places: rounded off over 1 m",)
    road, top_m = Road(read.settings), 50.0 * (1 + 1.75 / RADIUS_M)
    assert road.grade_at(top_m) == pytest.approx(0.0, abs=1e-3)
    assert road.heights_at(top_m) == pytest.approx(2.5, abs=0.02)
    assert abs(road.grade_at(top_m - 1) * (1 + 1.75 / RADIUS_M)) == pytest.approx(0.05, abs=1e-4)


def test_a_level_road_on_a_hill_and_a_bank_of_zero_are_flat(tmp_path):
    level = tags("elevation", ((0.0, (312.0, 0.0, 0.0, 0.0)),))
    read = read_opendrive(file(tmp_path, level, tags("superelevation", ((0.0, (0.0,) * 4),))))
    assert Road(read.settings).flat
    assert read.notes == ()


@pytest.mark.parametrize(
    ("hill", "lean", "says"),
    [
        (((0.0, (0.0,) * 4), (50.0, (0.5, 0.0, 0.0, 0.0))), (), r":3:\d+: <elevation>.*jumps by 0.5"),
        ((), ((0.0, (0.0,) * 4), (50.0, (0.1, 0, 0, 0))), r":4:\d+: <superelevation>.*jumps by"),
        (((0.0, (0.0, 0.6, 0.0, 0.0)),), (), "a grade of .*: expected less than 0.35"),
        ((), ((0.0, (0.5, 0.0, 0.0, 0.0)),), "a bank .*: expected less than 0.3"),
        (((10.0, (0.0, 0.1, 0.0, 0.0)), (5.0, (0.0,) * 4)), (), "s runs backwards"),
    ],
)
def test_jumps_and_slopes_that_no_road_has_are_refused_with_their_place(hill, lean, says, tmp_path):
    with pytest.raises(InputError, match=says):
        read_opendrive(file(tmp_path, tags("elevation", hill), tags("superelevation", lean)))


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    hill=st.lists(
        st.tuples(st.floats(-0.12, 0.12), st.floats(-2.5, 2.5)), max_size=4
    ),  # no steeper than 0.35
    lean=st.lists(st.floats(-0.06, 0.06), max_size=4),
    closed=st.booleans(),
)
@example(hill=[(0.0, 1.0)], lean=[0.03125], closed=False)  # one height, and a bank
def test_export_and_import_return_any_profile(tmp_path, hill, lean, closed):
    plain = load_road("circuit").settings if closed else load_road("s_bend").settings
    road = plain.model_copy(
        update={
            "elevation": tuple(
                ElevationPoint(at_m=7.0 + 31.0 * i, grade=grade, height_m=up_m)
                for i, (grade, up_m) in enumerate(hill)
            ),
            "bank": tuple(BankPoint(at_m=3.0 + 29.0 * i, bank_rad=rad) for i, rad in enumerate(lean)),
        }
    )
    path = tmp_path / "road.xodr"
    write_opendrive(road, path)
    before, after = Road(road), Road(read_opendrive(path).settings)
    stations = np.linspace(0.0, before.length_m, 500)
    for offset_m in (-2.0, 0.0, 2.0):
        level = float(before.heights_at(0.0)) if after.elevation is None else 0.0
        np.testing.assert_allclose(
            after.heights_at(stations, offset_m), before.heights_at(stations, offset_m) - level, atol=1e-6
        )


def test_another_reader_finds_the_same_heights(tmp_path):
    network = pytest.importorskip("pyxodr.road_objects.network")
    road, path = load_road("crest"), tmp_path / "road.xodr"
    write_opendrive(road.settings, path)
    line = network.RoadNetwork(str(path), resolution=0.5).get_roads()[0]
    heights_m = line.z_coordinates
    stations = road.nearest_coordinates(line.reference_line[:, :2])[:, 0]
    np.testing.assert_allclose(heights_m, road.heights_at(stations), atol=1e-2)
