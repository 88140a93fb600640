"""The road: closure, continuity, road and world coordinates."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.integrate import quad

from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.features import SpeedHump
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.config import CONFIG_DIR, InputError

CIRCUIT = load_road("circuit")
S_BEND = load_road("s_bend")
ROADS = [load_road(path) for path in sorted((CONFIG_DIR / "roads").glob("*.yaml"))]


def road(*segments: Segment, closed: bool = False) -> Road:
    return Road(
        RoadSettings(
            name="test",
            closed=closed,
            lane_width_m=3.5,
            segments=segments,
            sections=(Section(name="only", start_m=0),),
        )
    )


def test_the_circuit_closes_in_position_and_heading():
    end, start = CIRCUIT.poses([CIRCUIT.length_m - 1e-9, 0.0])
    assert np.hypot(*(end - start)[:2]) < 1e-3
    assert end[2] - start[2] == pytest.approx(2 * math.pi, abs=1e-4)


def test_the_circuit_has_the_length_bends_and_sections_of_the_main_job():
    curvature = CIRCUIT.poses(np.arange(0, CIRCUIT.length_m, 0.1))[:, 3]
    names = {section.name for section in CIRCUIT.sections}
    assert 1000 <= CIRCUIT.length_m <= 1300
    assert curvature.max() == pytest.approx(1 / 15, rel=1e-6) and curvature.min() < -1 / 30
    assert {"marked", "unmarked", "worn", "glare", "yellow", "shadows"} <= names


@pytest.mark.parametrize("road", ROADS, ids=lambda road: road.name)
def test_curvature_is_continuous_and_its_rate_is_drivable(road):
    stations = np.arange(0, road.length_m, 0.05)
    rate = np.abs(np.diff(road.poses(stations)[:, 3])) / 0.05
    speed_mps, wheelbase_m = 5.5, 1.75
    assert wheelbase_m * rate.max() * speed_mps < 0.6
    assert rate.max() * speed_mps**3 < 5.0


@pytest.mark.parametrize("road", ROADS, ids=lambda road: road.name)
def test_heading_is_the_derivative_of_position_and_curvature_that_of_heading(road):
    stations, h = np.linspace(1, road.length_m - 1, 400), 1e-4
    ahead, behind, here = road.poses(stations + h), road.poses(stations - h), road.poses(stations)
    tangent = (ahead - behind)[:, :2] / (2 * h)
    assert tangent == pytest.approx(np.column_stack([np.cos(here[:, 2]), np.sin(here[:, 2])]), abs=1e-7)
    assert (ahead - behind)[:, 2] / (2 * h) == pytest.approx(here[:, 3], abs=1e-6)


def test_a_clothoid_agrees_with_adaptive_quadrature():
    bend = road(Segment(length_m=40, curvature_1pm=(0.0, 0.08)), Segment(length_m=30, curvature_1pm=0.08))
    x, y = bend.position(37.3, 0.0)
    rate = 0.08 / 40
    assert x == pytest.approx(quad(lambda s: math.cos(rate * s * s / 2), 0, 37.3, epsabs=1e-12)[0], abs=1e-9)
    assert y == pytest.approx(quad(lambda s: math.sin(rate * s * s / 2), 0, 37.3, epsabs=1e-12)[0], abs=1e-9)


def test_an_arc_lies_on_its_circle():
    circle = road(Segment(length_m=2 * math.pi * 20, curvature_1pm=1 / 20), closed=True)
    points = circle.positions(np.linspace(0, circle.length_m, 50), 0.0)
    assert np.hypot(points[:, 0], points[:, 1] - 20) == pytest.approx(20, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    share=st.floats(0, 0.9999),
    offset_m=st.floats(-6, 6),
    hint_error_m=st.floats(-3, 3),
    road=st.sampled_from(ROADS),
)
def test_local_coordinates_invert_position(share, offset_m, hint_error_m, road):
    station_m = share * road.length_m
    point = road.position(station_m, offset_m)
    for hint in (None, station_m + hint_error_m):
        station, offset = road.local_coordinates(*point, near_station_m=hint)
        assert math.remainder(station - station_m, road.length_m if road.closed else 1e9) == pytest.approx(
            0, abs=1e-6
        )
        assert offset == pytest.approx(offset_m, abs=1e-6)


def test_vectorised_and_scalar_methods_agree():
    stations, offsets = np.linspace(-5, 1200, 97), np.linspace(-4, 4, 97)
    points = CIRCUIT.positions(stations, offsets)
    one_by_one = [CIRCUIT.position(s, d) for s, d in zip(stations, offsets, strict=True)]
    assert points == pytest.approx(np.array(one_by_one), abs=1e-9)
    local = [CIRCUIT.local_coordinates(*point) for point in points]
    assert CIRCUIT.nearest_coordinates(points) == pytest.approx(np.array(local), abs=1e-6)


def test_a_hint_selects_the_branch_of_the_road():
    hairpin = road(
        Segment(length_m=60),
        Segment(length_m=5, curvature_1pm=(0, 0.2)),
        Segment(length_m=math.pi * 5 - 5, curvature_1pm=0.2),
        Segment(length_m=5, curvature_1pm=(0.2, 0)),
        Segment(length_m=60),
    )
    x, y = hairpin.position(20.0, 6.0)
    assert hairpin.local_coordinates(x, y, near_station_m=19.0) == pytest.approx((20.0, 6.0), abs=1e-6)
    assert hairpin.local_coordinates(x, y)[0] > 60


def test_the_mirror_image_of_a_road_has_the_mirror_image_of_its_geometry():
    mirrored = road(
        *(
            Segment(
                length_m=segment.length_m,
                curvature_1pm=(-segment.start_curvature_1pm, -segment.end_curvature_1pm),
            )
            for segment in S_BEND.settings.segments
        )
    )
    stations = np.linspace(0, S_BEND.length_m, 50)
    left, right = S_BEND.positions(stations, 1.3), mirrored.positions(stations, -1.3)
    assert left * [1, -1] == pytest.approx(right, abs=1e-9)


def test_an_open_road_continues_straight_beyond_both_ends():
    curve = load_road("curve")
    assert curve.position(-30.0, 2.0) == pytest.approx((-30.0, 2.0), abs=1e-9)
    assert curve.curvature_at(curve.length_m + 50) == 0
    a, b, c = (np.array(curve.position(curve.length_m + s, 0.0)) for s in (0, 20, 40))
    assert b - a == pytest.approx(c - b, abs=1e-9)
    assert curve.local_coordinates(-30.0, 2.0) == pytest.approx((-30.0, 2.0), abs=1e-6)


def test_a_section_extends_from_its_start_to_the_next():
    for here, following in pairwise(CIRCUIT.sections):
        assert CIRCUIT.section_at(here.start_m) is here
        assert CIRCUIT.section_at(following.start_m - 1e-6) is here
    assert CIRCUIT.section_at(-1.0) is CIRCUIT.sections[-1]
    assert CIRCUIT.section_at(CIRCUIT.length_m + 1) is CIRCUIT.sections[0]


def test_a_jump_in_curvature_is_refused_with_its_place():
    with pytest.raises(ValueError, match=r"jumps from 0.0 to 0.1 1/m after segments.0"):
        road(Segment(length_m=10), Segment(length_m=10, curvature_1pm=0.1))


def test_a_closed_road_that_does_not_close_is_refused(tmp_path):
    text = (CONFIG_DIR / "roads" / "circuit.yaml").read_text().replace("122.454767", "123.454767")
    (tmp_path / "open.yaml").write_text(text)
    with pytest.raises(InputError, match=r"open.yaml: circuit does not close: .* 1.0000 m"):
        load_road(tmp_path / "open.yaml")


def test_sections_out_of_order_are_refused():
    with pytest.raises(ValueError, match="rising order"):
        RoadSettings.model_validate(
            CIRCUIT.settings.model_dump() | {"sections": CIRCUIT.settings.sections[::-1]}
        )


@pytest.mark.parametrize(
    ("wall", "says"),
    [
        (dict(side="left", from_m=10, to_m=500), "beyond the road.s"),
        (dict(side="left", from_m=30, to_m=10), "must end beyond its start"),
        (
            dict(side="left", from_m=10, to_m=40, distance_m=9.0),
            "beyond the centre of a bend of 10.0 m radius",
        ),
    ],
)
def test_a_wall_off_the_road_backwards_or_beyond_the_centre_of_its_bend_is_refused(wall, says):
    bend = dict(name="bend", closed=False, lane_width_m=3.4, sections=[dict(name="plain", start_m=0)])
    segments = [dict(length_m=50, curvature_1pm=0.1)]
    with pytest.raises(ValidationError, match=says):
        RoadSettings.model_validate({**bend, "segments": segments, "walls": [wall]})
    outside = {**wall, "side": "right", "from_m": 10, "to_m": 40}
    assert RoadSettings.model_validate({**bend, "segments": segments, "walls": [outside]}).walls


SECTIONS = [{"name": "only", "start_m": 0}]
HUMPED = {"segments": [{"length_m": 60}], "humps": [{"at_m": 20, "length_m": 4, "height_m": 0.12}]}


@given(st.floats(10, 30), st.floats(0.2, 4))
@settings(max_examples=40, deadline=None)
def test_over_a_hump_a_vehicle_stands_on_its_two_axles(station_m, wheelbase_m):
    humped = Road(
        RoadSettings.model_validate(
            {**S_BEND.settings.model_dump(), **HUMPED, "closed": False, "sections": SECTIONS}
        )
    )
    stations = np.array([station_m, station_m + wheelbase_m])
    inside = (stations > 20) & (stations < 24)
    rear_m, front_m = np.where(inside, 0.06 * (1 - np.cos(np.pi * (stations - 20) / 2)), 0.0)
    assert humped.pitch_over_humps(station_m, wheelbase_m) == pytest.approx(
        (rear_m - front_m) / wheelbase_m, abs=1e-12
    )


def test_a_hump_at_the_start_of_a_lap_lifts_the_front_at_its_end():
    humped = Road(CIRCUIT.settings.model_copy(update={"humps": (SpeedHump(at_m=0.0),)}))
    assert humped.pitch_over_humps(humped.length_m - 1.0, 2.5) < -0.03
    assert humped.pitch_over_humps(humped.length_m - 1.0, 0.5) == 0.0


@pytest.mark.parametrize(
    ("hump", "says"),
    [
        ({"at_m": 58}, "humps.0 ends at 61.7 m"),
        ({"at_m": 5, "length_m": 1, "height_m": 0.1}, "slope of 0.31"),
        ({"at_m": 5, "height_m": 0}, "greater than 0"),
    ],
)
def test_a_hump_beyond_the_road_or_as_steep_as_a_kerb_is_refused(hump, says):
    changed = {**S_BEND.settings.model_dump(), "segments": [{"length_m": 60}], "humps": [hump]}
    with pytest.raises(ValidationError, match=says):
        RoadSettings.model_validate({**changed, "sections": SECTIONS, "closed": False})
