"""Jitter and path jitter: a jump counts as an error; a change that equals the motion of the car does not."""

from collections.abc import Sequence

import pytest

from supervisor.inputs.consistency import AHEAD_M, KNOWN_M, Consistency, Steadiness
from supervisor.inputs.validation import ValidatedEstimate
from trepid.clothoid import Lane, Motion

MOTION = Motion(8.0, 0.2)


def estimate_of(
    lane: Lane | None, t_s: float, *, marked: bool | None = None, ahead_m: float = 8.0
) -> ValidatedEstimate:
    return ValidatedEstimate("cnn", 0.0, t_s, False, 0.9, lane, ahead_m, None, False, marked=marked)


def steadiness(
    lanes: Sequence[Lane | None], *, repeats: int = 1, motion: Motion = MOTION, marked: bool | None = None
) -> Steadiness:
    consistency = Consistency()
    for number, lane in enumerate(lanes):
        for _ in range(repeats):
            found = consistency.step([estimate_of(lane, 0.04 * number, marked=marked)], motion)
    return found["cnn"]


def jitter_m(
    lanes: Sequence[Lane | None], *, repeats: int = 1, motion: Motion = MOTION, marked: bool | None = None
) -> float:
    return steadiness(lanes, repeats=repeats, motion=motion, marked=marked).jitter_m


def jumping(frames: int) -> list[Lane]:
    lane, lanes = Lane(0.0, 0.0, 0.0, 0.0), []
    for number in range(frames):
        lane = lane.after(MOTION, 0.04)
        lanes.append(lane._replace(offset_m=lane.offset_m + (0.15 if number % 2 else -0.15)))
    return lanes


def test_a_lane_that_moves_as_the_car_does_has_no_jitter() -> None:
    lanes = [Lane(0.2, 0.01, 0.02, 0.0)]
    for _ in range(20):
        lanes.append(lanes[-1].after(MOTION, 0.04))
    assert jitter_m(lanes) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_lane_that_jumps_to_and_fro_has_the_size_of_its_jumps(repeats: int) -> None:
    assert jitter_m(jumping(60), repeats=repeats) == pytest.approx(0.3, rel=0.05)


def test_a_gap_restarts_the_jitter() -> None:
    assert jitter_m([Lane(0.0, 0.0, 0.0, 0.0), *[None] * 20, Lane(1.0, 0.0, 0.0, 0.0)]) == 0.0


def bent(error_1pm: float, frames: int) -> list[Lane]:
    """A straight road that the car follows, reported with a curvature wrong by ``error_1pm`` in every frame."""
    return [Lane(0.0, 0.0, error_1pm, 0.0)] * frames


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_curvature_that_is_wrong_in_every_frame_drifts_although_it_hardly_jumps(side: float) -> None:
    """Over 3 m of way the lane turns by 3·0.033 rad; the point that lay 8 m ahead moves by 0.69 m."""
    lanes = bent(0.033 * side, 40)
    straight = Motion(8.0, 0.0)
    assert jitter_m(lanes, motion=straight, marked=True) == pytest.approx(0.6, abs=0.1)
    assert jitter_m(bent(0.0, 40), motion=straight, marked=True) == 0.0
    assert jitter_m(lanes[:3], motion=straight, marked=True) < 0.1
    assert jitter_m(lanes, motion=straight) < 0.1  # an estimator without memory


@pytest.mark.parametrize("first_m", [2.0, 4.0])
def test_lanes_are_compared_as_far_as_both_are_stated(first_m: float) -> None:
    """A bend stated up to ``first_m`` alone, by which it leads 0.1 m aside or less, on a straight road."""
    seen = [(Lane(0.0, 0.0, 0.0, 0.5 / first_m**3), first_m), *[(Lane(0.0, 0.0, 0.0, 0.0), 8.0)] * 20]
    consistency = Consistency()
    for number, (lane, ahead_m) in enumerate(seen):
        estimate = estimate_of(lane, 0.04 * number, marked=True, ahead_m=ahead_m)
        found = consistency.step([estimate], Motion(8.0, 0.0))
        assert found["cnn"].jitter_m < 0.12


def test_a_drift_no_longer_counts_a_second_after_it_was_measured() -> None:
    consistency, t_s = Consistency(), 0.0
    for speed_mps, frames in ((8.0, 40), (0.0, 80)):
        for lane in bent(0.033, frames):
            found = consistency.step([estimate_of(lane, t_s, marked=True)], Motion(speed_mps, 0.0))
            t_s += 0.04
    assert found["cnn"].jitter_m < 0.01


def test_jumps_to_and_fro_are_no_drift() -> None:
    assert jitter_m(jumping(61), marked=True) == pytest.approx(jitter_m(jumping(61)), rel=0.1)


def test_a_turn_counts_by_its_displacement_ahead() -> None:
    turned = jitter_m([Lane(0.0, 0.0, 0.0, 0.0), Lane(0.0, 0.0, 0.0, 0.0)._replace(heading_rad=0.1)])
    assert turned < 0.1 * AHEAD_M


@pytest.mark.parametrize("repeats", [1, 3])
def test_path_jitter_of_constant_jumps_is_their_size(repeats: int) -> None:
    assert steadiness(jumping(120), repeats=repeats).path_jitter_m == pytest.approx(0.3, rel=0.05)


def test_two_steady_seconds_end_the_jitter_but_not_the_path_jitter() -> None:
    lanes = jumping(60)
    for _ in range(50):
        lanes.append(lanes[-1].after(MOTION, 0.04))
    calmed = steadiness(lanes)
    assert calmed.jitter_m < 0.05
    assert calmed.path_jitter_m > 0.05


def test_path_jitter_does_not_decay_at_standstill() -> None:
    consistency, standing = Consistency(), Motion(0.0, 0.0)
    for number, lane in enumerate(jumping(60)):
        moved = consistency.step([estimate_of(lane, 0.04 * number)], MOTION)["cnn"]
    for number in range(60, 600):
        stood = consistency.step([estimate_of(lane, 0.04 * number)], standing)["cnn"]
    assert stood.jitter_m < 1e-6
    assert stood.path_jitter_m == moved.path_jitter_m


def test_a_gap_does_not_change_the_path_jitter() -> None:
    lanes = jumping(60)
    assert steadiness([*lanes, *[None] * 20, lanes[0]]).path_jitter_m == steadiness(lanes).path_jitter_m


def test_without_two_lanes_path_jitter_has_its_initial_value() -> None:
    assert steadiness([None]).path_jitter_m == KNOWN_M
    assert steadiness([Lane(0.0, 0.0, 0.0, 0.0)]).path_jitter_m == pytest.approx(KNOWN_M)
