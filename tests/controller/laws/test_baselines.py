"""Pure pursuit and Stanley against geometry."""

import math

import pytest
from controller_rig import SETTINGS
from hypothesis import given, settings
from hypothesis import strategies as st
from message_rig import SHUTTLE

from controller.laws.lateral import LawName, build_law
from controller.laws.law import Acting
from trepid.clothoid import Lane

signed = st.floats(-0.3, 0.3)


def law(name):
    return build_law(SETTINGS.lateral.model_copy(update=dict(law=name)), SHUTTLE)


def demand_1pm(name, offset=0.0, heading=0.0, curvature=0.0, rate=0.0, speed_mps=5.0):
    lane = Lane(offset, heading, curvature, rate, 30.0)
    return law(name).curvature(Acting(lane, speed_mps, 0.0, 0.0, 0.0, lane), dt_s=0.02)


def test_pure_pursuit_from_a_straight_lane_is_the_circle_through_the_goal():
    ahead_m = max(SETTINGS.lateral.pure_pursuit.min_ahead_m, SETTINGS.lateral.pure_pursuit.ahead_s * 5.0)
    radius_m = 1.0 / demand_1pm(LawName.PURE_PURSUIT, offset=-0.5)
    assert math.hypot(ahead_m, 0.5 - radius_m) == pytest.approx(radius_m)


@pytest.mark.parametrize("curvature", [0.01, -0.03])
def test_on_a_circle_pure_pursuit_with_its_rear_and_stanley_with_its_front_axle_demand_it(curvature):
    assert demand_1pm(LawName.PURE_PURSUIT, curvature=curvature) == pytest.approx(curvature, rel=0.01)
    inside_m = SHUTTLE.wheelbase_m**2 * curvature / 2.0
    assert demand_1pm(LawName.STANLEY, offset=inside_m, curvature=curvature) == pytest.approx(
        curvature, rel=0.01
    )


def test_stanley_puts_the_front_axle_back_by_its_arc_tangent():
    stanley = SETTINGS.lateral.stanley
    angle_rad = math.atan(stanley.gain_1ps * 0.4 / (5.0 + stanley.softening_mps))
    expected = -math.tan(angle_rad) / SHUTTLE.wheelbase_m
    assert demand_1pm(LawName.STANLEY, offset=0.4) == pytest.approx(expected)


@pytest.mark.parametrize("name", list(LawName))
@settings(deadline=None)  # the first call of MPC builds its problem
@given(signed, signed, signed, signed, st.floats(0.0, 30.0))
def test_every_law_is_mirror_symmetric_and_finite(name, offset, heading, curvature, rate, speed_mps):
    left = demand_1pm(name, offset, heading, curvature, 0.1 * rate, speed_mps)
    assert left == -demand_1pm(name, -offset, -heading, -curvature, -0.1 * rate, speed_mps)
    assert math.isfinite(left)
