import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.steering import lane_centre_m, pursuit_curvature, road_wheel_angle

small = st.floats(-0.5, 0.5)


def test_a_centred_vehicle_on_an_arc_is_told_the_curvature_of_the_arc():
    kappa = pursuit_curvature(8.0, offset_m=0, heading_rad=0, curvature_1pm=0.03, curvature_rate_1pm2=0)
    assert kappa == pytest.approx(0.03)


@given(e=small, psi=small)
def test_left_of_the_lane_or_turned_left_steers_right(e, psi):
    kappa = pursuit_curvature(8.0, offset_m=e, heading_rad=psi, curvature_1pm=0, curvature_rate_1pm2=0)
    assert kappa == pytest.approx(-2 * (e + 8 * psi) / 64)


@given(e=small, psi=small, kappa=st.floats(-0.05, 0.05), rate=st.floats(-0.005, 0.005), x=st.floats(1, 15))
def test_the_mirrored_lane_gives_the_opposite_command(e, psi, kappa, rate, x):
    lane = dict(offset_m=e, heading_rad=psi, curvature_1pm=kappa, curvature_rate_1pm2=rate)
    mirror = {name: -value for name, value in lane.items()}
    assert lane_centre_m(x, **mirror) == pytest.approx(-lane_centre_m(x, **lane))
    assert pursuit_curvature(x, **mirror) == pytest.approx(-pursuit_curvature(x, **lane))


@given(kappa=st.floats(-0.2, 0.2), wheelbase=st.floats(0.3, 4))
def test_the_wheel_angle_turns_a_kinematic_vehicle_with_that_curvature(kappa, wheelbase):
    angle = road_wheel_angle(kappa, wheelbase_m=wheelbase)
    assert math.tan(angle) / wheelbase == pytest.approx(kappa, abs=1e-12)
