"""The lane state of boundaries that bend (inventory S18 with curvature)."""

import numpy as np
import pytest
from boundary_rig import VIEW, WIDTH_M, arc, sides
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.techniques.image.picture import Boundaries, Boundary, MeasuredLane
from perception.techniques.steering.lane import draw_boundaries, ground_curve
from trepid.clothoid import Lane


def lane_of(offset_m: float, heading_rad: float, curvature_1pm: float, shown: str = "both") -> MeasuredLane:
    course = arc(np.inf if curvature_1pm == 0 else 1 / curvature_1pm, offset_m, heading_rad)
    x_m = np.linspace(3.0, 22.0, 60)
    left, right = (Boundary(side[:, 0], side[:, 1], 0.0, 1.0) for side in sides(course, x_m))
    found = ground_curve(
        Boundaries(left if shown != "right" else None, right if shown != "left" else None),
        VIEW,
        width_m=WIDTH_M,
    )
    assert found is not None
    return found


@settings(max_examples=40, deadline=None)
@given(e=st.floats(-1, 1), psi=st.floats(-0.1, 0.1), kappa=st.floats(-0.02, 0.02))
def test_a_bending_lane_gives_its_offset_heading_curvature_and_width(e, psi, kappa):
    lane = lane_of(e, psi, kappa)
    assert lane.lane.offset_m == pytest.approx(e * np.cos(psi), abs=0.03)
    assert lane.lane.heading_rad == pytest.approx(psi, abs=0.006)
    assert lane.lane.curvature_1pm == pytest.approx(kappa, abs=0.001)
    assert lane.width_m == pytest.approx(WIDTH_M, rel=0.01)


@settings(max_examples=20, deadline=None)
@given(e=st.floats(-1, 1), psi=st.floats(-0.1, 0.1), kappa=st.floats(-0.02, 0.02))
def test_the_mirrored_boundaries_have_the_mirrored_lane(e, psi, kappa):
    one, other = lane_of(e, psi, kappa), lane_of(-e, -psi, -kappa)
    assert other.lane.offset_m == pytest.approx(-one.lane.offset_m, abs=1e-9)
    assert other.lane.heading_rad == pytest.approx(-one.lane.heading_rad, abs=1e-9)
    assert other.lane.curvature_1pm == pytest.approx(-one.lane.curvature_1pm, abs=1e-9)


@pytest.mark.parametrize("shown", ["left", "right"])
def test_one_boundary_gives_the_same_lane_without_its_width(shown):
    both, one = lane_of(0.3, 0.05, 0.01), lane_of(0.3, 0.05, 0.01, shown)
    assert one.width_m is None
    assert one.lane.offset_m == pytest.approx(both.lane.offset_m, abs=0.03)
    assert one.lane.heading_rad == pytest.approx(both.lane.heading_rad, abs=np.radians(0.5))


@given(e=st.floats(-1, 1), psi=st.floats(-0.2, 0.2), kappa=st.floats(-0.02, 0.02), width=st.floats(2.5, 4.5))
@settings(max_examples=40, deadline=None)
def test_a_drawn_lane_is_measured_again(e, psi, kappa, width):
    lane = Lane(e, psi, kappa, 0.0)
    again = ground_curve(draw_boundaries(lane, width, near_m=3, far_m=25, residual_m=0.0, support=1.0), VIEW)
    assert (*again.lane[:3], again.width_m) == pytest.approx((*lane[:3], width), abs=1e-4)


def test_no_boundary_is_no_lane_and_a_weak_one_counts_less():
    assert ground_curve(Boundaries(None, None), VIEW) is None
    x_m = np.linspace(3, 20, 30)
    good = Boundary(x_m, np.full(30, 1.7), 0.02, 1.0)
    tilted = Boundary(x_m, -1.7 + 0.05 * x_m, 0.6, 0.3)
    assert abs(ground_curve(Boundaries(good, tilted), VIEW).lane.heading_rad) < 0.01
