"""The straight stretch of road that was shown, and lanes that leave it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lane.model.evidence import BoundarySupport, LaneFit
from perception.lane.model.geometry import LaneState
from perception.lane.model.prediction import VehicleMotion
from perception.lane.model.shown import StraightStretch

GATE_RAD, MAX_S, SHOWN_M, SPEED_MPS = 0.06, 10.0, 30.0, 8.0
TIGHT = np.diag([0.01, 0.001, 1e-5, 1e-7, 0.01, 1e-4]) ** 2
POSES = st.floats(-1.0, 1.0), st.floats(-0.3, 0.3)


SIDE = BoundarySupport(excess=0.5, extent_m=20.0, seen=True)


def lane_fit(offset_m=0.0, heading_rad=0.0, curvature_1pm=0.0, rate_1pm2=0.0, *, end_m=SHOWN_M) -> LaneFit:
    mean = np.array([offset_m, heading_rad, curvature_1pm, rate_1pm2, 3.4, 0.0])
    return LaneFit(LaneState(mean, TIGHT), SIDE, SIDE, 0.5, end_m=end_m)


SHOWN = StraightStretch.of(lane_fit(), 0.0, before=None)


def after(shown: StraightStretch, way_m: float) -> StraightStretch | None:
    return shown.after(VehicleMotion(SPEED_MPS, 0.0), way_m / SPEED_MPS, max_s=MAX_S)


@given(*POSES, st.sampled_from([8.0, -8.0]))
def test_an_arc_around_a_corner_leaves_a_straight_from_every_place_and_heading(
    offset_m, heading_rad, radius_m
):
    assert SHOWN.is_left_by(lane_fit(offset_m, heading_rad, 1 / radius_m, end_m=10.0), GATE_RAD)


@given(*POSES, st.floats(0.0, 0.9 * SHOWN_M))
def test_a_straight_lane_never_leaves_it(offset_m, heading_rad, way_m):
    assert not after(SHOWN, way_m).is_left_by(lane_fit(offset_m, heading_rad), GATE_RAD)


@given(st.floats(-0.05, 0.05), st.floats(-0.001, 0.001))
def test_a_bend_and_its_mirror_image_leave_it_alike(bend_1pm, rate_1pm2):
    both = [SHOWN.is_left_by(lane_fit(0.0, 0.0, s * bend_1pm, s * rate_1pm2), GATE_RAD) for s in (1, -1)]
    assert both[0] == both[1]


@pytest.mark.parametrize(("way_m", "leaves"), [(0.0, True), (SHOWN_M - 9.0, True), (SHOWN_M - 1.0, False)])
def test_a_bend_beyond_the_stretch_that_was_shown_does_not_leave_it(way_m, leaves):
    assert after(SHOWN, way_m).is_left_by(lane_fit(0.0, 0.0, 0.05), GATE_RAD) == leaves


def test_a_bend_that_is_only_roughly_known_does_not_leave_the_stretch():
    fit = lane_fit(0.0, 0.0, 0.02)
    rough = LaneFit(LaneState(fit.state.mean, TIGHT * 1e6), SIDE, SIDE, 0.5, end_m=SHOWN_M)
    assert SHOWN.is_left_by(fit, GATE_RAD)
    assert not SHOWN.is_left_by(rough, GATE_RAD)


@pytest.mark.parametrize("end_m", [8.0, 40.0])
def test_a_short_view_keeps_what_was_shown_beyond(end_m):
    assert StraightStretch.of(lane_fit(end_m=end_m), 0.0, before=SHOWN).to_m == max(end_m, SHOWN_M)


@pytest.mark.parametrize(
    ("speed_mps", "t_s"), [(None, 0.1), (SPEED_MPS, -0.1), (SPEED_MPS, 4.0), (0.0, MAX_S + 0.1)]
)
def test_nothing_is_shown_without_a_speed_before_its_time_beyond_its_end_or_too_long_after(speed_mps, t_s):
    assert SHOWN.after(VehicleMotion(speed_mps, 0.0), t_s, max_s=MAX_S) is None
