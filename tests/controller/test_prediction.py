"""The speed to steer with falls with the brake and never rises without a measurement."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.prediction import ReckonedSpeed


def test_without_any_measurement_there_is_no_speed():
    assert ReckonedSpeed(0.15).step(None, 0.01) is None


def test_a_steady_brake_takes_its_deceleration_times_the_time_less_the_lag():
    reckoned = ReckonedSpeed(0.15)
    reckoned.step(8.0, 0.0)
    reckoned.demand_mps2 = -1.0
    for _ in range(300):
        speed_mps = reckoned.step(None, 0.01)
    assert speed_mps == pytest.approx(8.0 - (3.0 - 0.15), abs=0.02)


@given(st.lists(st.floats(-5.0, 5.0), max_size=100))
def test_it_never_rises_and_never_is_negative(demands_mps2):
    reckoned = ReckonedSpeed(0.15)
    before_mps = reckoned.step(2.0, 0.0)
    for demand_mps2 in demands_mps2:
        reckoned.demand_mps2 = demand_mps2
        speed_mps = reckoned.step(None, 0.05)
        assert 0.0 <= speed_mps <= before_mps
        before_mps = speed_mps
