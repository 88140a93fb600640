"""Claims about the road-wheel angle of a kinematic vehicle."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.car.vehicle import road_wheel_angle


@given(kappa=st.floats(-0.2, 0.2), wheelbase=st.floats(0.3, 4))
def test_the_wheel_angle_turns_a_kinematic_vehicle_with_that_curvature(kappa, wheelbase):
    angle = road_wheel_angle(kappa, wheelbase_m=wheelbase)
    assert math.tan(angle) / wheelbase == pytest.approx(kappa, abs=1e-12)
