"""A body on springs: closed form of its swing, signs, and what stands still."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.springs import MOST_RAD, BodyOnSprings, Springs

SPRINGS = Springs()
FORCES = st.floats(-6, 6)


def swing(body: BodyOnSprings, ahead_mps2: float, left_mps2: float, *times_s: float):
    return [body.step(ahead_mps2, left_mps2, now_s=now_s) for now_s in times_s]


@given(ahead=FORCES, left=FORCES)
@settings(max_examples=20, deadline=None)
def test_under_a_constant_force_the_body_comes_to_rest_at_its_gradient(ahead, left):
    body = BodyOnSprings(SPRINGS)
    body.step(0.0, 0.0, now_s=0.0)
    end = swing(body, ahead, left, 10.0)[0]
    assert end.pitch_rad == pytest.approx(-SPRINGS.pitch_gradient_rad_per_mps2 * ahead, abs=1e-9)
    assert end.roll_rad == pytest.approx(SPRINGS.roll_gradient_rad_per_mps2 * left, abs=1e-9)


def test_the_swing_is_that_of_the_differential_equation():
    goal, natural = -SPRINGS.pitch_gradient_rad_per_mps2 * -4.0, math.tau * SPRINGS.frequency_hz

    def rates(state, _):
        angle, rate = state
        return (rate, natural**2 * (goal - angle) - 2 * SPRINGS.damping_ratio * natural * rate)

    state, body = (0.0, 0.0), BodyOnSprings(SPRINGS)
    body.step(0.0, 0.0, now_s=0.0)
    for number in range(1, 41):
        for _ in range(20):
            state = rk4(rates, state, None, None, None, 0.002)
        assert body.step(-4.0, 0.0, now_s=0.04 * number).pitch_rad == pytest.approx(state[0], abs=1e-7)


@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=8))
@settings(max_examples=20, deadline=None)
def test_under_a_constant_force_the_number_of_steps_does_not_matter(spans_s):
    times_s = np.cumsum(spans_s).tolist()
    ends = []
    for chosen in (times_s, times_s[-1:]):
        body = BodyOnSprings(SPRINGS)
        body.step(0.0, 0.0, now_s=0.0)
        ends.append(swing(body, 1.0, -2.0, *chosen)[-1])
    assert ends[0].pitch_rad == pytest.approx(ends[1].pitch_rad, abs=1e-12)
    assert ends[0].roll_rad == pytest.approx(ends[1].roll_rad, abs=1e-12)


def test_brakes_lower_the_nose_and_a_left_bend_lifts_the_left_side():
    body = BodyOnSprings(SPRINGS)
    attitude = body.step(-3.0, 2.0, now_s=0.0)
    assert attitude.pitch_rad > 0.01
    assert attitude.roll_rad > 0.01


def test_a_load_in_the_rear_lifts_the_nose_for_good():
    attitude = BodyOnSprings(SPRINGS, load_kg=300.0).step(0.0, 0.0, now_s=0.0)
    assert attitude.pitch_rad == pytest.approx(300.0 * SPRINGS.load_pitch_rad_per_kg)
    assert attitude.pitch_rad < 0


def test_the_stops_of_the_springs_end_pitch_and_roll():
    attitude = BodyOnSprings(SPRINGS).step(-90.0, -90.0, now_s=0.0)
    assert (attitude.pitch_rad, attitude.roll_rad) == (MOST_RAD, -MOST_RAD)


def test_on_moving_axles_the_swing_is_that_of_the_differential_equation():
    natural, rate = math.tau * SPRINGS.frequency_hz, 0.3  # of the axles [rad/s]
    axles = [rate * t for t in (0.0, 0.04, 0.08, 0.08, 0.04, 0.0, 0.0, 0.0)]

    def rates(state, axle):
        angle, speed = state
        at, moving = axle
        return (speed, natural**2 * (at - angle) - 2 * SPRINGS.damping_ratio * natural * (speed - moving))

    state, body = (0.0, 0.0), BodyOnSprings(SPRINGS)
    body.step(0.0, 0.0, now_s=0.0)
    for number, (before, here) in enumerate(itertools.pairwise(axles), start=1):
        slope, steps = (here - before) / 0.04, 200
        for part in range(steps):
            middle = before + slope * 0.04 * (part + 0.5) / steps
            half = 0.04 / steps / 2
            speeds = rates(state, (middle, slope))
            between = (state[0] + half * speeds[0], state[1] + half * speeds[1])
            speeds = rates(between, (middle, slope))
            state = (state[0] + 2 * half * speeds[0], state[1] + 2 * half * speeds[1])
        pitch_rad = body.step(0.0, 0.0, now_s=0.04 * number, axles_rad=here).pitch_rad
        assert pitch_rad == pytest.approx(state[0], abs=1e-6)


def test_a_parked_body_takes_the_pitch_of_its_axles():
    attitude = BodyOnSprings(SPRINGS).step(0.0, 0.0, now_s=0.0, axles_rad=-0.03)
    assert attitude.pitch_rad == pytest.approx(-0.03)
