"""The driver before a start at speed: exact at the hand-over, and consistent on the way there."""

import math

import pytest

from sim_harness.lockstep.run_up import rail
from sim_harness.scenarios.scenario import Start, load_scenario

STRAIGHT = load_scenario("straight").build_road()
CURVE = load_scenario("curve_left_r15").build_road()
START = Start(station_m=100.0, offset_m=0.2, speed_mps=20.0, drift_mps=0.6)


def test_at_the_hand_over_the_car_has_the_state_of_the_scenario():
    here = rail(START, STRAIGHT, 0.0)
    assert (here.station_m, here.offset_m, here.curvature_1pm) == (100.0, pytest.approx(0.2), 0.0)
    assert 20.0 * math.sin(here.course_rad) == pytest.approx(0.6)


def test_before_the_drift_it_drives_along_the_lane():
    here = rail(START, STRAIGHT, -3.0)
    assert (here.station_m, here.course_rad, here.curvature_1pm) == (40.0, 0.0, 0.0)
    assert here.offset_m == pytest.approx(0.2 - 0.6 * 1.5 / 2)  # the drift covers half of v_y·t


@pytest.mark.parametrize("elapsed_s", [-1.4, -0.8, -0.1])
def test_offset_course_and_curvature_are_derivatives_of_each_other(elapsed_s):
    h = 1e-5
    before, here, after = (rail(START, STRAIGHT, elapsed_s + k * h) for k in (-1, 0, 1))
    sideways_mps = (after.offset_m - before.offset_m) / (2 * h)
    assert 20.0 * math.sin(here.course_rad) == pytest.approx(sideways_mps, rel=1e-6)
    turning_radps = (after.course_rad - before.course_rad) / (2 * h)
    assert 20.0 * here.curvature_1pm == pytest.approx(turning_radps, rel=1e-6)


def test_a_drift_to_the_other_side_is_the_mirror_image():
    mirrored = START.model_copy(update={"drift_mps": -0.6, "offset_m": -0.2})
    left, right = (rail(start, STRAIGHT, -0.7) for start in (START, mirrored))
    assert (right.offset_m, right.course_rad, right.curvature_1pm) == pytest.approx(
        (-left.offset_m, -left.course_rad, -left.curvature_1pm)
    )


def test_in_a_bend_the_wheels_are_turned_for_it():
    start = Start(station_m=78.0, speed_mps=5.0)
    assert rail(start, CURVE, 0.0).curvature_1pm == pytest.approx(1 / 15)


def test_a_drift_needs_speed():
    with pytest.raises(ValueError, match=r"drift_mps 0\.5 needs a speed_mps of 1\.25"):
        Start(drift_mps=0.5)
