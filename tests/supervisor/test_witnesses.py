"""Estimators as witnesses against each other: by what they state to know, and in their own world only."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from supervisor_rig import ESTIMATE, SETTINGS, STATE, Drive

from trepid.messages import Mode, SteeringEstimate

SURE_M = (0.02, 0.02, 0.03, 0.05, 0.1, 0.2)
VAGUE_M = (0.3, 0.3, 0.5, 2.0, 4.0, 8.0)  # of a network on a road unlike those of its training
STRAIGHT = replace(
    ESTIMATE,
    lateral_offset_m=0.1,
    heading_error_rad=0.0,
    curvature_1pm=0.0,
    curvature_rate_1pm2=0.0,
    confidence=0.999,
    marked=True,
    ahead_sigma_m=SURE_M,
)
NETWORK = replace(
    STRAIGHT, estimator="cnn", confidence=0.98, lanes_detected=0, lane_width_m=None, marked=None
)
OUTSIDE = SteeringEstimate.nothing(0.0, estimator="cnn", lookahead_m=8.0, reason="not a road of its world")
DRIVEN = replace(STATE, driver_override=True)
SPEEDS_MPS = (5.0, 8.0, 15.0, 25.0, 35.0)


def wandering(t_s: float) -> SteeringEstimate:
    """A network on a plain highway: bends of 300 m and more that come and go, and a deviation that says so."""
    return replace(NETWORK, curvature_1pm=0.003 + 0.001 * math.sin(3.0 * t_s), ahead_sigma_m=VAGUE_M)


@pytest.mark.parametrize("speed_mps", SPEEDS_MPS)
def test_a_vague_network_on_a_plain_highway_keeps_nobody_from_taking_over_and_fear_is_low(
    speed_mps: float,
) -> None:
    drive, fears = Drive(speed_mps=speed_mps), []
    for frame in range(200):
        state = DRIVEN if drive.now_s < 2.2 else STATE
        decision = drive.frame(cv=STRAIGHT, cnn=wandering(drive.now_s), state=state)
        if frame >= 75:
            assert decision.mode is not Mode.STOP
            fears.append(decision.fear)
    assert sum(fears) / len(fears) <= 0.1


@pytest.mark.parametrize("speed_mps", SPEEDS_MPS)
@pytest.mark.parametrize(
    "changed",
    [
        pytest.param(lambda v: {"cnn": replace(NETWORK, curvature_1pm=2.5 / v**2)}, id="bent network"),
        pytest.param(lambda _: {"cv": replace(STRAIGHT, lateral_offset_m=0.8)}, id="lines 0.7 m aside"),
    ],
)
def test_one_of_two_estimators_that_lies_with_a_small_deviation_is_feared_within_a_second(
    changed: Callable[[float], dict[str, SteeringEstimate]], speed_mps: float
) -> None:
    drive, both = Drive(speed_mps=speed_mps), {"cv": STRAIGHT, "cnn": NETWORK}
    drive.last(3.0, **both, state=DRIVEN)
    assert drive.last(1.0, **both).fear == 0
    decision = drive.last(1.0, **(both | changed(speed_mps)))
    assert decision.fear >= 0.5 and decision.cause == "disagreement"


@pytest.mark.parametrize("speed_mps", SPEEDS_MPS)
def test_one_estimator_that_is_surely_right_takes_over_and_slows_down_after_its_time(
    speed_mps: float,
) -> None:
    drive = Drive(speed_mps=speed_mps)
    drive.last(2.2, cv=STRAIGHT, cnn=OUTSIDE, state=DRIVEN)
    decision = drive.last(0.8, cv=STRAIGHT, cnn=OUTSIDE)
    assert decision.mode is not Mode.STOP and decision.fear <= 0.1
    late = drive.last(20.0, cv=STRAIGHT, cnn=OUTSIDE)
    assert (late.mode, late.cause) == (Mode.CAUTION, "single_source")
    assert late.fear == pytest.approx(0.5)


def test_one_estimator_that_is_surely_right_starts_from_standstill() -> None:
    drive = Drive()
    assert drive.last(SETTINGS.modes.reengage_after_s + 0.3, cv=STRAIGHT, cnn=OUTSIDE).mode is not Mode.STOP


def test_an_estimator_outside_its_world_is_no_witness() -> None:
    """A network without confidence may report any lane."""
    drive = Drive(speed_mps=25.0)
    drive.last(3.0, cv=STRAIGHT, cnn=NETWORK, state=DRIVEN)
    unfit = replace(NETWORK, curvature_1pm=0.05, lateral_offset_m=1.5, confidence=0.1)
    assert drive.last(1.0, cv=STRAIGHT, cnn=unfit).fear <= 0.1


@pytest.mark.parametrize(
    "sigma_m",
    [(math.nan, *SURE_M[1:]), (*SURE_M[:-1], math.inf), (-0.1, *SURE_M[1:]), SURE_M[:3], (1e30,) * 6],
)
def test_impossible_deviations_make_an_estimate_broken(sigma_m: tuple[float, ...]) -> None:
    drive = Drive.under_way()
    assert drive.last(0.2, cv=STRAIGHT, cnn=NETWORK).fear == 0
    assert drive.frame(cv=STRAIGHT, cnn=replace(NETWORK, ahead_sigma_m=sigma_m)).fear == 1
