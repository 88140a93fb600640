"""Claims about the LQI law on a lane."""

import math
from itertools import pairwise

import numpy as np
import pytest
from controller_rig import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE, vehicle

from controller.laws.law import Acting
from controller.laws.lqi import Lqi
from controller.laws.lqi_settings import SPEEDS_MPS
from trepid.clothoid import Lane

LQI = SETTINGS.lateral.lqi
signed = st.floats(-0.3, 0.3)


def acting(offset=0.0, heading=0.0, curvature=0.0, rate=0.0, path=0.0, wheel=0.0, speed_mps=10.0):
    lane = Lane(offset, heading, curvature, rate, 30.0)
    return Acting(lane, speed_mps, 0.0, path, wheel, lane)


def law(car=SHUTTLE):
    return Lqi(LQI, car, command_delay_s=0.01)


@given(signed, signed, signed, signed, signed, signed, st.floats(0.0, 40.0))
def test_the_law_is_mirror_symmetric(offset, heading, curvature, rate, path, wheel, speed_mps):
    left, right = (
        law().curvature(
            acting(
                sign * offset,
                sign * heading,
                sign * curvature,
                sign * 0.1 * rate,
                sign * path,
                sign * wheel,
                speed_mps,
            ),
            dt_s=0.02,
        )
        for sign in (1.0, -1.0)
    )
    assert left == -right
    assert math.isfinite(left)


def test_on_the_centre_of_a_bend_it_demands_the_bend():
    assert law().curvature(acting(curvature=0.02, path=0.02, wheel=0.02), dt_s=0.02) == pytest.approx(0.02)


def test_on_a_clothoid_it_demands_the_curvature_one_lag_ahead():
    car = vehicle(steering_lag_s=0.2)
    demanded = law(car).curvature(acting(curvature=0.02, rate=0.001, path=0.02, wheel=0.02), dt_s=0.02)
    assert demanded == pytest.approx(0.02 + 0.001 * 10.0 * 0.2)


def test_an_offset_that_stays_is_answered_more_and_more_up_to_the_bound():
    one = law()
    first = one.curvature(acting(offset=-0.1), dt_s=0.0)
    for _ in range(100):
        later = one.curvature(acting(offset=-0.1), dt_s=0.02)
    for _ in range(100_000):
        last = one.curvature(acting(offset=-0.1), dt_s=0.02)
    assert 0.0 < first < later < last
    assert last - first == pytest.approx(LQI.max_integral_mps2 / 10.0**2)
    one.release()
    assert one.curvature(acting(offset=-0.1), dt_s=0.0) == first


def test_far_from_the_centre_nothing_winds_up():
    one = law()
    first = one.curvature(acting(offset=3.0), dt_s=0.0)
    for _ in range(1000):
        later = one.curvature(acting(offset=3.0), dt_s=0.02)
    assert later == first


def test_far_from_the_centre_it_demands_at_most_the_largest_approach_angle():
    approach_rad = math.asin(LQI.max_approach_mps / 10.0)
    for far in (5.0, 7.0):
        demanded = law().curvature(acting(offset=far, heading=-approach_rad), dt_s=0.0)
        assert demanded == pytest.approx(0.0, abs=1e-12)


def test_far_from_the_centre_it_turns_in_more_gently():
    """Per metre of offset, where the approach angle does not bound it yet."""
    near, far = (abs(law().curvature(acting(offset=e), dt_s=0.0)) / e for e in (0.1, 0.6))
    assert far < 0.6 * near


def test_slow_steering_is_given_a_slow_loop():
    quick, slow = (law(vehicle(steering_delay_s=d, steering_lag_s=d)).designs[6] for d in (0.05, 0.3))
    assert slow.bandwidth_radps < 0.7 * quick.bandwidth_radps


def test_at_standstill_and_in_reverse_the_law_is_finite():
    for speed_mps in (0.0, -3.0, 1e-9):
        assert math.isfinite(law().curvature(acting(0.5, 0.2, 0.05, 0.01, speed_mps=speed_mps), dt_s=0.02))


def test_the_schedule_has_no_steps():
    one = law()
    demanded = [one.curvature(acting(0.1, speed_mps=v), dt_s=0.0) for v in np.geomspace(0.3, 90.0, 1000)]
    assert max(abs(b / a - 1.0) for a, b in pairwise(demanded)) < 0.03
    assert len(one.designs) == len(SPEEDS_MPS)
