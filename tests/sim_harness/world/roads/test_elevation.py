"""Height profiles of roads: heights and grades against closed forms, and their faults."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.elevation import Elevation, ElevationPoint
from sim_harness.world.roads.road import Road, RoadSettings, Segment

GRADES = st.floats(-0.12, 0.12)


def profile(*points: tuple[float, ...], length_m: float = 500.0, closed: bool = False) -> Elevation:
    names = ("at_m", "grade", "height_m")
    made = [ElevationPoint(**dict(zip(names, point, strict=False))) for point in points]
    return Elevation(made, length_m=length_m, closed=closed)


def test_between_two_grades_the_height_is_a_parabola_of_constant_radius():
    hill = profile((100.0, 0.06), (220.0, -0.06))
    radius_m = 120.0 / 0.12
    stations = np.linspace(100.0, 220.0, 50)
    run = stations - 100.0
    np.testing.assert_allclose(hill.heights_at(stations), 0.06 * run - run**2 / (2 * radius_m), atol=1e-9)
    assert hill.grade_at(160.0) == pytest.approx(0.0, abs=1e-12)


def test_beyond_its_ends_the_profile_of_an_open_road_keeps_its_grade():
    hill = profile((100.0, 0.06), (220.0, -0.04, 5.0))
    np.testing.assert_allclose(hill.heights_at([0.0, 50.0, 320.0]), [-6.0, -3.0, 1.0])
    assert hill.grade_at(-1e3) == 0.06
    assert hill.grade_at(1e3) == -0.04


@given(
    grades=st.lists(GRADES, min_size=2, max_size=5),
    heights=st.lists(st.floats(-5, 5), min_size=5, max_size=5),
)
@settings(max_examples=50, deadline=None)
def test_height_and_grade_are_continuous_and_the_grade_is_the_slope_of_the_height(grades, heights):
    points = [(80.0 * i, grade, heights[i]) for i, grade in enumerate(grades)]
    hill = profile(*points)
    for at_m, grade, height_m in points:
        np.testing.assert_allclose(hill.heights_at([at_m - 1e-6, at_m, at_m + 1e-6]), height_m, atol=1e-5)
        assert hill.grade_at(at_m) == pytest.approx(grade)
        assert hill.grade_at(at_m - 1e-6) == pytest.approx(grade, abs=1e-5)
    for station_m in np.linspace(-20.0, 400.0, 30):
        low, high = hill.heights_at([station_m - 0.01, station_m + 0.01])
        assert hill.grade_at(station_m) == pytest.approx((high - low) / 0.02, abs=1e-4)


def test_a_closed_road_returns_to_the_height_and_the_grade_of_its_start():
    ring = profile((10.0, 0.02, 3.0), (250.0, -0.03, 7.0), length_m=400.0, closed=True)
    stations = np.linspace(0.0, 400.0, 21)
    np.testing.assert_allclose(ring.heights_at(stations), ring.heights_at(stations + 400.0), atol=1e-9)
    assert ring.grade_at(10.0 + 400.0 - 1e-7) == pytest.approx(0.02, abs=1e-6)
    assert ring.heights_at([410.0 - 1e-7])[0] == pytest.approx(3.0, abs=1e-6)


def test_the_pieces_are_the_cubics_of_opendrive():
    hill = profile((0.0, 0.05, 1.0), (100.0, -0.02, 4.0))
    (start, a, b, c, d), last = hill.records
    assert last == (100.0, 4.0, -0.02, 0.0, 0.0)
    ds = np.linspace(0.0, 100.0, 9)
    np.testing.assert_allclose(a + b * ds + c * ds**2 + d * ds**3, hill.heights_at(start + ds), atol=1e-9)


@pytest.mark.parametrize(
    ("points", "closed", "says"),
    [
        ([(50.0, 0.01), (50.0, 0.02)], False, "not beyond the point before"),
        ([(0.0, 0.01), (250.0, 0.02)], False, "the road is 200.0 m long"),
        ([(0.0, 0.5)], False, "less than"),
    ],
)
def test_a_profile_that_runs_backwards_or_off_the_road_is_refused(points, closed, says):
    with pytest.raises(ValidationError, match=says):
        RoadSettings(
            name="hill",
            closed=closed,
            lane_width_m=3.4,
            segments=(Segment(length_m=200),),
            sections=(Section(name="plain", start_m=0),),
            elevation=[{"at_m": at_m, "grade": grade} for at_m, grade in points],
        )


def test_a_road_without_a_profile_is_flat():
    flat = Road(
        RoadSettings(
            name="flat",
            closed=False,
            lane_width_m=3.4,
            segments=(Segment(length_m=200),),
            sections=(Section(name="plain", start_m=0),),
        )
    )
    assert flat.elevation is None
    assert flat.grade_at(50.0) == 0.0
    assert not flat.heights_at([0.0, 10.0]).any()
