"""Tracking: lanes through gaps, dropouts, wrong predicted and swaps (inventory T01–T06, B26)."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.techniques.image.picture import Boundaries, FrameMotion
from perception.techniques.steering.kalman import ExtendedKalman, Kalman, UnscentedKalman, nis, spread, update
from perception.techniques.steering.lane import draw_boundaries, ground_curve
from perception.techniques.steering.sampled import Bayes, Particles, resample_indices
from perception.techniques.steering.tracking import (
    E,
    Samples,
    expected_offsets,
    expected_slope,
    moved_state,
    process_noise,
    transition,
)
from trepid.clothoid import Lane

TRACKERS = {
    "kalman": Kalman,
    "extended": ExtendedKalman,
    "unscented": UnscentedKalman,
    "particles": Particles,
    "bayes": Bayes,
}
SPEED_MPS, DT_S, WIDTH_M = 10.0, 0.04, 3.5
NOTHING = Boundaries(None, None, "nothing there")


def drive(seconds: float, *, seed: int = 0, e: float = 0.3, radius_m: float = 80.0):
    """True states and motions of a car that weaves along a lane with a bend after two seconds."""
    rng = np.random.default_rng(seed)
    state, drives = np.array([e, 0.0, 0.0, WIDTH_M]), []
    phase = rng.uniform(0, 6)
    for number in range(round(seconds / DT_S)):
        t_s = number * DT_S
        state[2] = 0.0 if t_s < 2 else 1 / radius_m
        rate = SPEED_MPS * state[2] + 0.08 * math.cos(1.2 * t_s + phase) - 0.25 * state[0] - 0.8 * state[1]
        motion = FrameMotion(DT_S, SPEED_MPS, rate)
        state = moved_state(state, motion)
        drives.append((state.copy(), motion))
    return drives


def noisy_boundaries(state: np.ndarray, rng: np.random.Generator, *, noise: float = 1.0) -> Boundaries:
    """Both sides with the error of a boundary model."""
    error = rng.normal(size=4) * [0.06, 0.01, 0.0015, 0.05] * noise
    e, psi, kappa, width = (state + error).tolist()
    lane = Lane(e, psi, kappa, 0.0)
    return draw_boundaries(lane, width, near_m=4, far_m=24, residual_m=0.03, support=0.9)


def errors(name: str, keep, *, seconds: float = 6.0, seed: int = 0, noise: float = 1.0) -> np.ndarray:
    """|e − true e| and |ψ − true ψ| after every frame; ``keep(number, boundaries)`` may hide it. NaN: no answer."""
    tracker, rng = TRACKERS[name](), np.random.default_rng(seed + 100)
    found = []
    for number, (state, motion) in enumerate(drive(seconds, seed=seed)):
        lane = ground_curve(tracker.step(keep(number, noisy_boundaries(state, rng, noise=noise)), motion))
        found.append(
            [np.nan, np.nan]
            if lane is None
            else [lane.lane.offset_m - state[0], lane.lane.heading_rad - state[1]]
        )
    return np.abs(np.array(found))


@cache
def errors_of_all_frames(name: str) -> np.ndarray:
    """The errors over eight seconds with nothing hidden."""
    return errors(name, lambda n, b: b, seconds=8)


@pytest.mark.parametrize("name", TRACKERS)
def test_a_gap_of_a_second_is_bridged_to_a_tenth_of_a_metre(name):
    worst = [
        errors(name, lambda n, b: NOTHING if 100 <= n < 125 else b, seconds=5.2, seed=seed)[100:125, 0].max()
        for seed in range(3)
    ]
    assert np.median(worst) < 0.1


@pytest.mark.parametrize("name", ["extended", "unscented"])
@pytest.mark.parametrize("seed", range(4))
def test_thirty_metres_without_markings_are_bridged_in_the_lane(name, seed):
    off = errors(name, lambda n, b: NOTHING if 60 <= n < 135 else b, seconds=7, seed=seed)[:, 0]
    assert np.isfinite(off).all()
    assert off[60:135].max() < 0.5 and off[150:].max() < 0.2


@pytest.mark.parametrize("name", TRACKERS)
def test_half_of_all_frames_lost_raises_the_error_by_less_than_half(name):
    lost = np.random.default_rng(3).random(400) < 0.5
    lost[0] = False
    with_all = errors_of_all_frames(name)
    with_half = errors(name, lambda n, b: NOTHING if lost[n] else b, seconds=8)
    assert np.isfinite(with_half).all()
    # The place eight metres ahead determines the steering.
    ahead_all, ahead_half = ((off[:, 0] + 8 * off[:, 1]).mean() for off in (with_all, with_half))
    assert ahead_half < 1.5 * ahead_all


@pytest.mark.parametrize("name", TRACKERS)
def test_tracking_is_better_than_its_frames(name):
    rng = np.random.default_rng(100)
    alone = [
        abs(ground_curve(noisy_boundaries(state, rng)).lane.offset_m - state[0]) for state, _ in drive(6)
    ]
    assert errors_of_all_frames(name)[20:150, 0].mean() < 0.8 * np.mean(alone[20:])


@pytest.mark.parametrize("name", TRACKERS)
def test_one_side_is_enough_while_the_other_is_hidden(name):
    off = errors(name, lambda n, b: Boundaries(b.left, None, "no right line") if n > 60 else b)
    assert off[60:, 0].max() < 0.25


@pytest.mark.parametrize("name", TRACKERS)
def test_a_lane_lost_for_too_long_is_none_and_not_the_old_one(name):
    tracker, rng = TRACKERS[name](), np.random.default_rng(0)
    drives = drive(4)
    for state, motion in drives[:25]:
        tracker.step(noisy_boundaries(state, rng), motion)
    last = NOTHING
    supports = []
    for _ in range(110):
        last = tracker.step(NOTHING, FrameMotion(DT_S, SPEED_MPS, 0.0))
        supports.append(last.left.support if last.left else 0.0)
    assert last.side_count == 0 and last.reason
    assert all(after <= before for before, after in pairwise(supports))


@pytest.mark.parametrize("name", TRACKERS)
def test_a_single_wrong_frame_does_not_move_the_lane_far(name):
    def wrong(number: int, boundaries: Boundaries) -> Boundaries:
        if number != 80:
            return boundaries
        return draw_boundaries(
            Lane(-1.2, 0.1, 0.0, 0.0), 3.5, near_m=4, far_m=24, residual_m=0.03, support=0.9
        )

    assert errors(name, wrong, seconds=3.4)[80, 0] < 0.3


@pytest.mark.parametrize("name", TRACKERS)
def test_the_new_lane_is_tracked_within_half_a_second_of_a_swap(name):
    tracker, rng, found = TRACKERS[name](), np.random.default_rng(0), []
    for number in range(75):
        state = np.array([1.6 if number < 50 else -1.9, 0.0, 0.0, WIDTH_M])  # over the line: the next lane
        motion = FrameMotion(DT_S, SPEED_MPS, 0.0)
        found.append(
            ground_curve(tracker.step(noisy_boundaries(state, rng), motion)).lane.offset_m - state[0]
        )
    assert abs(found[50 + round(0.5 / DT_S)]) < 0.3 and abs(found[-1]) < 0.2


@pytest.mark.parametrize("name", TRACKERS)
def test_the_same_frames_give_the_same_lane(name):
    assert np.array_equal(errors(name, lambda n, b: b, seconds=2), errors_of_all_frames(name)[:50])


# --- the parts


def test_the_innovations_of_the_linear_filter_match_its_covariance():
    rng = np.random.default_rng(5)
    truth, mean, covariance, values = np.zeros(4), np.zeros(4), np.eye(4) * 0.01, []
    noise, slope = np.diag(np.array([0.08, 0.015, 0.004, 0.12]) ** 2), np.eye(4)
    motion = FrameMotion(DT_S, SPEED_MPS, 0.0)
    matrix, drift = transition(motion), process_noise(motion)
    for _ in range(600):
        truth = matrix @ truth + rng.normal(size=4) * np.sqrt(np.diag(drift))
        mean, covariance = matrix @ mean, matrix @ covariance @ matrix.T + drift
        innovation = truth + rng.normal(size=4) * np.sqrt(np.diag(noise)) - mean
        values.append(nis(covariance, innovation, slope, noise))
        mean, covariance = update(mean, covariance, innovation, slope, noise)
    low, high = 0.484, 11.143  # χ² with four degrees of freedom, 2.5 % and 97.5 %
    inside = np.mean([(low < value < high) for value in values])
    assert 0.92 < inside < 0.98


@settings(max_examples=20, deadline=None)
@given(e=st.floats(-1, 1), psi=st.floats(-0.2, 0.2), kappa=st.floats(-0.03, 0.03))
def test_the_motion_and_its_matrix_agree_for_small_changes(e, psi, kappa):
    motion, state = FrameMotion(0.04, 10.0, 0.1), np.array([e, psi, kappa, 3.5])
    nudged = (moved_state(state + np.eye(4) * 1e-6, motion) - moved_state(state, motion)).T / 1e-6
    assert nudged == pytest.approx(transition(motion), abs=0.02)


def test_the_slope_of_the_samples_is_exact_when_centred():
    look = Samples(np.array([5.0, 20.0]), np.zeros(2), np.array([1.0, -1.0]), np.ones(2))
    slope = expected_slope(np.array([0.0, 0.0, 0.0, 3.5]), look)
    assert slope == pytest.approx(
        np.array([[-1, -5, 12.5, 0.5], [-1, -20, 200, -0.5]]), abs=1e-4
    )  # −1, −x, x²/2, ±½
    assert expected_offsets(np.array([0.4, 0.0, 0.0, 3.5]), look)[0] == pytest.approx(1.35)


def test_spread_points_have_the_mean_and_covariance_they_stand_for():
    covariance = np.array([[0.2, 0.01], [0.01, 0.05]])
    points = spread(np.array([1.0, 2.0]), covariance)
    assert points.mean(axis=0) == pytest.approx([1.0, 2.0])
    assert np.cov(points.T, bias=True) == pytest.approx(covariance)


def test_resampling_draws_each_particle_in_proportion_to_its_weight():
    weight = np.array([0.5, 0.0, 0.25, 0.25])
    counts = np.bincount(
        resample_indices(np.repeat(weight, 100) / 100, np.random.default_rng(0)) // 100, minlength=4
    )
    assert counts == pytest.approx(weight * 400, abs=1)


def test_the_updates_are_those_of_filterpy():
    kalman = pytest.importorskip("filterpy.kalman", reason="filterpy, the oracle, is not installed")
    rng = np.random.default_rng(1)
    theirs = kalman.KalmanFilter(dim_x=4, dim_z=3)
    theirs.x, theirs.P = np.zeros(4), np.diag([1.0, 0.1, 0.01, 0.3])
    theirs.H, theirs.R = np.eye(4)[:3], np.diag([0.01, 0.002, 0.0001])
    motion = FrameMotion(DT_S, SPEED_MPS, 0.2)
    theirs.F, theirs.Q = transition(motion), process_noise(motion)
    mean, covariance = theirs.x.copy(), theirs.P.copy()
    for _ in range(20):
        measured = rng.normal(size=3) * 0.1
        theirs.predict()
        theirs.update(measured)
        mean, covariance = theirs.F @ mean, theirs.F @ covariance @ theirs.F.T + theirs.Q
        mean, covariance = update(mean, covariance, measured - theirs.H @ mean, theirs.H, theirs.R)
    assert mean == pytest.approx(theirs.x, abs=1e-12)
    assert covariance == pytest.approx(theirs.P, abs=1e-12)


def test_the_unscented_points_are_those_of_filterpy():
    kalman = pytest.importorskip("filterpy.kalman", reason="filterpy, the oracle, is not installed")
    covariance = np.array([[0.2, 0.01, 0.0], [0.01, 0.05, 0.02], [0.0, 0.02, 0.1]])
    theirs = kalman.MerweScaledSigmaPoints(3, alpha=1.0, beta=0.0, kappa=0.0).sigma_points(
        np.zeros(3), covariance
    )
    ours = spread(np.zeros(3), covariance)
    assert np.sort(ours.ravel()) == pytest.approx(np.sort(theirs[1:].ravel()), abs=1e-12)


def test_unknown_motion_keeps_the_lane():
    state = np.array([0.3, 0.1, 0.01, 3.5])
    assert moved_state(state, FrameMotion(0.04, None, None)) == pytest.approx(state)
    assert moved_state(state, FrameMotion(0.04, 10.0, None))[E] > 0.3  # it points left and goes on
