"""Faults: their times, and the output of a biased estimator."""

from dataclasses import replace

import pytest
from message_rig import estimate

from sim_harness.scenarios.faults import BlackFrames, EstimatorBias
from trepid.car.vehicle import road_wheel_angle
from trepid.clothoid import Lane
from trepid.messages import EstimateKind, SteeringEstimate

SEEN = estimate(
    t_s=1.0,
    heading_error_rad=0.02,
    curvature_1pm=0.01,
    curvature_rate_1pm2=0.001,
    confidence=0.6,
    lane_width_m=3.5,
)
WHEELBASE_M = 2.0


def bias(**fields):
    return EstimatorBias(kind="estimator_bias", estimator="cv", from_s=0, **fields)


def test_a_fault_is_there_from_its_beginning_until_just_before_its_end():
    fault = BlackFrames(kind="black_frames", from_s=2, to_s=3)
    assert [fault.active(t) for t in (-1.0, 1.99, 2.0, 2.99, 3.0)] == [False, False, True, True, False]
    assert BlackFrames(kind="black_frames", from_s=2).active(1e6)


def test_a_bias_changes_offset_heading_curvature_and_confidence():
    changed = bias(lateral_m=0.5, heading_rad=-0.01, curvature_1pm=0.02, confidence=0.99).falsify(
        SEEN, wheelbase_m=WHEELBASE_M
    )
    shifted = (changed.lateral_offset_m, changed.heading_error_rad, changed.curvature_1pm)
    assert shifted == pytest.approx((0.6, 0.01, 0.03))
    assert (changed.confidence, changed.t_s, changed.lane_width_m) == (0.99, 1.0, 3.5)


def test_a_bias_without_confidence_keeps_that_of_the_estimate():
    assert bias(lateral_m=0.5).falsify(SEEN, wheelbase_m=WHEELBASE_M).confidence == SEEN.confidence


def test_a_bias_leaves_an_estimate_without_a_lane_unchanged():
    nothing = SteeringEstimate.nothing(1.0, estimator="cv", lookahead_m=8.0, reason="dark")
    assert bias(lateral_m=0.5, confidence=1.0).falsify(nothing, wheelbase_m=WHEELBASE_M) is nothing


def angle_of(lane: SteeringEstimate) -> float:
    """The wheel angle of pure pursuit in ``lane``."""
    centre = Lane.of_message(lane)
    assert centre is not None
    return road_wheel_angle(centre.pursuit_curvature(lane.lookahead_m), wheelbase_m=WHEELBASE_M)


def of_kind_angle(angle_rad: float | None) -> SteeringEstimate:
    nothing = SteeringEstimate.nothing(
        1.0, estimator="cv", lookahead_m=SEEN.lookahead_m, reason="", kind=EstimateKind.ANGLE
    )
    return replace(nothing, road_wheel_angle_rad=angle_rad, confidence=0.6)


@pytest.mark.parametrize(
    "fields",
    [
        {"lateral_m": 0.5},
        {"heading_rad": -0.05},
        {"curvature_1pm": 0.02},
        {"lateral_m": -0.3, "confidence": 1.0},
    ],
)
def test_a_bias_turns_an_angle_as_it_turns_the_angle_of_the_lane(fields):
    wrong_lane = bias(**fields).falsify(SEEN, wheelbase_m=WHEELBASE_M)
    changed = bias(**fields).falsify(of_kind_angle(angle_of(SEEN)), wheelbase_m=WHEELBASE_M)
    assert changed.road_wheel_angle_rad == pytest.approx(angle_of(wrong_lane))
    assert changed.confidence == wrong_lane.confidence
    assert changed.lateral_offset_m is changed.heading_error_rad is changed.curvature_1pm is None


def test_a_bias_leaves_an_estimate_without_an_angle_unchanged():
    nothing = of_kind_angle(None)
    assert bias(lateral_m=0.5, confidence=1.0).falsify(nothing, wheelbase_m=WHEELBASE_M) is nothing


@pytest.mark.parametrize(
    ("fault", "message"), [({}, "changes nothing"), ({"lateral_m": 1, "to_s": 0.0}, "greater than 0")]
)
def test_a_fault_that_does_nothing_is_refused(fault, message):
    with pytest.raises(ValueError, match=message):
        bias(**fault)


def test_a_fault_must_end_after_it_begins():
    with pytest.raises(ValueError, match="to_s 3 must be after from_s 5"):
        BlackFrames(kind="black_frames", from_s=5, to_s=3)
