"""Lanes by length against closed forms: arcs of more than 90°, rigid motions, derivatives by differences."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.tape.curve import BENDS, PSI, WIDTH, CurveFit, E, LaneCurve, arc_lane
from perception.tape.floor import TapePoints, VotingPoints
from perception.tape.settings import TapeSettings
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "tape.yaml", TapeSettings).curve
WIDTH_M = 3.3


def arc(bend_1pm: float, offset_m: float = 0.0, heading_rad: float = 0.0) -> LaneCurve:
    return arc_lane(SETTINGS, offset_m=offset_m, heading_rad=heading_rad, bend_1pm=bend_1pm, width_m=WIDTH_M)


def evenly(points: TapePoints) -> VotingPoints:
    """The points, of which each may lie on either side."""
    return VotingPoints(points, np.ones(len(points.x_m)), np.ones(len(points.x_m)))


def line_points(
    bend_1pm: float, side: float, from_m: float, to_m: float, offset_m: float = 0.0
) -> TapePoints:
    """Points on the left (1) or right (-1) boundary of an arc through (0, -offset), by the circle's formula."""
    s_m = np.arange(from_m, to_m, 0.15)
    middle = 1j * (1 / bend_1pm - offset_m)
    course = bend_1pm * s_m
    at = middle + (1 / bend_1pm - side * WIDTH_M / 2) * np.exp(1j * (course - math.pi / 2))
    count = len(s_m)
    return TapePoints(at.real, at.imag, course, np.full((count, 3), 50.0), np.ones(count), np.zeros(count))


@pytest.mark.parametrize("bend_1pm", [0.2, -0.2, 0.1, 0.3])
def test_an_arc_by_length_lies_on_its_circle_beyond_a_right_angle(bend_1pm: float) -> None:
    lane = arc(bend_1pm)
    drawn = lane.draw()
    assert np.abs(drawn.centre - 1j / bend_1pm) == pytest.approx(1 / abs(bend_1pm), abs=5e-3)
    assert np.unwrap(np.angle(drawn.along))[-1] - np.angle(drawn.along[lane.table.zero]) == pytest.approx(
        bend_1pm * SETTINGS.stations_m[-1]
    )


@pytest.mark.parametrize("bend_1pm", [0.2, -0.2])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_line_of_a_bend_gives_the_lane_when_the_width_is_known(bend_1pm: float, side: float) -> None:
    """From a start 0.4 m aside and 0.15 rad askew, on a straight lane."""
    points = line_points(bend_1pm, side, 0.0, 9.0, offset_m=0.3)
    start = arc(0.1 * bend_1pm, offset_m=-0.1, heading_rad=0.15)
    found = CurveFit(SETTINGS, WIDTH_M).fit(start, evenly(points), tracked=False)
    sigma = np.sqrt(np.diag(found.covariance))
    assert found.p[E] == pytest.approx(0.3, abs=sigma[E]) and sigma[E] < 0.15
    assert found.p[PSI] == pytest.approx(0.0, abs=2 * sigma[PSI]) and sigma[PSI] < 0.15
    placed = found.place(points, found.draw(), SETTINGS.slant_rad)
    assert placed.left_m == pytest.approx(side * found.width_m / 2, abs=0.06)
    assert found.p[BENDS + 3 : BENDS + 7] == pytest.approx(bend_1pm, abs=0.04)


def winding(first_1pm: float, then_1pm: float, before_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Centre and direction of a lane with a bend up to ``before_m`` and then one of 90°, by the sum of its chords.

    From 4 m behind the axle to 9 m ahead of it, in steps of 0.15 m.
    """
    s_m = np.arange(-4.0, 9.0, 0.15)
    within = s_m < before_m + math.pi / 2 / abs(then_1pm)
    turned = np.cumsum(np.where(s_m < before_m, first_1pm, then_1pm * within)) * 0.15
    here = int(np.argmin(np.abs(s_m)))
    along = np.exp(1j * (turned - turned[here]))
    centre = np.cumsum(along) * 0.15
    return centre - centre[here], along


@pytest.mark.parametrize("turn", [1.0, -1.0])
@pytest.mark.parametrize("before_m", [3.0, 2.0, 1.5])
def test_the_outer_line_gives_the_lane_where_a_bend_tighter_than_its_width_follows_another(
    turn: float, before_m: float
) -> None:
    """R = 5.5 m and then 2.2 m to the other side, as on tiles: three frames from the arc of the first bend."""
    first_1pm = -0.18 * turn
    centre, along = winding(first_1pm, turn / 2.2, before_m)
    outer, count = centre - turn * 1j * along * WIDTH_M / 2, len(centre)
    points = TapePoints(
        outer.real, outer.imag, np.angle(along), np.full((count, 3), 50.0), np.ones(count), np.zeros(count)
    )
    left = np.full(count, float(turn < 0))
    lane = arc(first_1pm)
    for _ in range(3):
        lane = CurveFit(SETTINGS, WIDTH_M).fit(lane, VotingPoints(points, left, 1 - left), tracked=True)
    ahead = lane.draw().centre[(lane.table.fine_m >= 0) & (lane.table.fine_m <= 6)]
    assert np.abs(ahead[:, None] - centre).min(axis=1).max() < 0.15


def test_a_clothoid_stands_for_a_lane_up_to_a_turn_of_a_radian_to_either_side() -> None:
    assert arc(0.1).clothoid(5.0).lookahead_m == 5.0
    reaches_m = [arc(bend_1pm).clothoid(5.0).lookahead_m for bend_1pm in (0.4, -0.4)]
    assert reaches_m == pytest.approx([2.5, 2.5], abs=0.3)
    bends = np.interp(SETTINGS.stations_m, [1.4, 1.6], [0.4, -0.4])
    to_and_fro = LaneCurve(SETTINGS.stations_m, np.r_[0.0, 0.0, WIDTH_M, bends], np.eye(BENDS + len(bends)))
    assert to_and_fro.clothoid(5.0).lookahead_m < 4.5


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_clothoid_ends_where_it_leaves_the_lane_behind_a_tight_bend(turn: float) -> None:
    """The place of the clothoid by the sum of its steps, and that of the lane."""
    bends = turn * np.interp(SETTINGS.stations_m, [0.0, 1.5], [-0.8, 0.0])
    lane = LaneCurve(SETTINGS.stations_m, np.r_[0.2, -0.1, WIDTH_M, bends], np.eye(BENDS + len(bends)))
    clothoid = lane.clothoid(5.0)
    step_m = 0.01
    s_m = np.arange(0.0, clothoid.lookahead_m + step_m / 2, step_m)
    turned = clothoid.curvature_1pm * s_m + clothoid.curvature_rate_1pm2 * s_m**2 / 2
    at = -0.2j * np.exp(0.1j) + step_m * np.cumsum(np.exp(1j * (turned + 0.1)))
    centre = lane.draw().centre[lane.table.zero :]
    assert np.abs(at[:, None] - centre).min(axis=1).max() < 0.2
    assert 1.5 <= clothoid.lookahead_m < 5.0


def test_two_lines_measure_the_width() -> None:
    left, right = line_points(0.1, 1.0, -2.0, 7.0), line_points(0.1, -1.0, -2.0, 7.0)
    wider = right._replace(x_m=right.x_m, y_m=right.y_m - 0.2 * np.cos(right.course_rad))
    points = left.plus(wider)
    found = CurveFit(SETTINGS, WIDTH_M).fit(arc(0.1), evenly(points), tracked=True)
    assert WIDTH_M + 0.1 < found.width_m < WIDTH_M + 0.25


@given(
    bend_1pm=st.floats(-0.2, 0.2),
    offset_m=st.floats(-0.5, 0.5),
    heading_rad=st.floats(-0.4, 0.4),
    way_m=st.floats(0.0, 0.5),
    turned_rad=st.floats(-0.1, 0.1),
)
def test_a_lane_moves_as_its_points_do(
    bend_1pm: float, offset_m: float, heading_rad: float, way_m: float, turned_rad: float
) -> None:
    lane = arc(bend_1pm, offset_m, heading_rad)
    moved = lane.after(way_m, turned_rad)
    to = cmath.rect(way_m, turned_rad / 2)
    before = (lane.draw().centre[18:44] - to) * cmath.exp(-1j * turned_rad)
    apart = np.abs(before[:, None] - moved.draw().centre).min(axis=1)
    assert apart.max() < 0.13  # half of the step between the points of the lane, and what it bends in it
    nearest = moved.draw()
    left_m = [
        ((point - nearest.centre) * np.conj(nearest.along)).imag[np.argmin(np.abs(point - nearest.centre))]
        for point in before
    ]
    assert np.abs(left_m).max() < 0.02


@given(bend_1pm=st.floats(-0.25, 0.25), offset_m=st.floats(-0.5, 0.5), heading_rad=st.floats(-0.5, 0.5))
def test_the_derivatives_of_the_distance_are_those_by_differences(
    bend_1pm: float, offset_m: float, heading_rad: float
) -> None:
    lane = arc(bend_1pm, offset_m, heading_rad)
    drawn = lane.draw()
    gradient = lane.gradient(drawn)
    for number in range(len(lane.p)):
        if number == WIDTH:
            continue
        step = np.zeros(len(lane.p))
        step[number] = 1e-5
        there = LaneCurve(lane.at_m, lane.p + step, lane.covariance).draw()
        left_m = ((drawn.centre - there.centre) * np.conj(drawn.along)).imag
        assert gradient[:, number] == pytest.approx(left_m / 1e-5, abs=1e-3)


def test_a_line_across_the_lane_counts_for_no_boundary() -> None:
    lane = arc(0.0)
    across = TapePoints(
        np.full(9, 2.0),
        np.linspace(-2, 2, 9),
        np.full(9, math.pi / 2),
        np.ones((9, 3)),
        np.ones(9),
        np.zeros(9),
    )
    assert not lane.place(across, lane.draw(), SETTINGS.slant_rad).beside.any()


def test_what_is_not_seen_is_less_certain_the_farther_ahead_it_lies() -> None:
    points = line_points(0.1, -1.0, 0.0, 4.0)
    found = CurveFit(SETTINGS, WIDTH_M).fit(arc(0.1), evenly(points), tracked=True)
    sigmas = found.ahead_sigma_m(found.gradient(found.draw()))
    assert list(sigmas[1:]) == sorted(sigmas[1:]) and sigmas[1] < 0.3 < sigmas[3]
    assert len(found.p) == BENDS + len(SETTINGS.stations_m)
