"""The expect block of a scenario and its verdict."""

from dataclasses import replace

import pytest
from trace_rig import state, trace_of, truth

from sim_harness.judging.conditions.expect import Expect, judge
from sim_harness.judging.metrics import Metrics
from sim_harness.judging.trace import Recorder

GOOD_RUN = Metrics(
    duration_s=10.0,
    distance_m=50.0,
    departures=0,
    interventions=0,
    autonomy_percent=100.0,
    max_lateral_error_m=0.2,
    rms_lateral_error_m=0.1,
    max_lateral_accel_mps2=2.0,
    max_lateral_jerk_mps3=1.0,
    max_decel_mps2=1.0,
    collisions=0,
    min_time_gap_s=None,
    mean_speed_mps=5.0,
    max_fear=0.1,
    mean_fear=0.1,
    modes={},
    causes={},
    engaged_percent=100.0,
    stop_cause=None,
)
RUN = trace_of([truth(0.0), truth(10.0)])


@pytest.mark.parametrize(
    ("expect", "change", "reason"),
    [
        ({}, {"departures": 1}, "departures 1: expected at most 0"),
        ({}, {"collisions": 2}, "collisions 2: expected at most 0"),
        ({"max_departures": 1}, {"departures": 1}, None),
        ({"max_lateral_error_m": 0.3}, {"max_lateral_error_m": 0.31}, "max_lateral_error_m 0.31"),
        ({"max_lateral_error_m": 0.3}, {"max_lateral_error_m": 0.3}, None),
        ({"min_mean_speed_mps": 5.0}, {"mean_speed_mps": 4.9}, "mean_speed_mps 4.9: expected at least 5"),
        ({"min_time_gap_s": 1.0}, {}, "min_time_gap_s unknown: expected at least 1"),
        ({"must_finish": True}, {}, "the route was not driven to its end"),
        ({"must_stand": True}, {}, "the car went 50.0 m: expected to stand"),
        ({"must_stand": True}, {"distance_m": 0.1}, None),
    ],
)
def test_a_run_is_judged_by_its_expect_block(expect, change, reason):
    reasons = judge(Expect(**expect), replace(GOOD_RUN, **change), RUN)
    assert len(reasons) == (reason is not None)
    assert all(reason in found for found in reasons)


@pytest.mark.parametrize(
    ("speeds_mps", "reason"),
    [
        ([5.0, 5.0, 0.0, 0.0], None),
        ([0.0, 0.0, 0.0, 0.0], "never moved"),
        ([5.0, 0.0, 0.0, 3.0], "moved at 3.00 s: expected to stand from 2 s on"),
    ],
)
def test_a_stop_must_follow_motion_and_last(speeds_mps, reason):
    recorder = Recorder()
    for t_s, speed_mps in enumerate(speeds_mps):
        recorder.add(truth(float(t_s)), state(float(t_s), speed_mps), None, None, {})
    reasons = judge(Expect(must_stop_by_s=2.0), GOOD_RUN, recorder.trace())
    assert len(reasons) == (reason is not None)
    assert all(reason in found for found in reasons)


def test_a_run_that_ends_before_the_stop_was_due_shows_nothing():
    (reason,) = judge(Expect(must_stop_by_s=12.0), GOOD_RUN, RUN)
    assert "the run ended before 12 s" in reason


@pytest.mark.parametrize(
    ("condition", "passes"),
    [("speed >= 9.9 m/s", True), ("speed >= 10.1 m/s", False), ("departures <= 0 at the end", True)],
)
def test_a_condition_that_does_not_hold_is_a_reason(condition, passes):
    reasons = judge(Expect(conditions=(condition,)), GOOD_RUN, RUN)
    assert (reasons == []) == passes
    assert all(condition in reason for reason in reasons)


def test_a_sentence_that_is_no_condition_is_refused():
    with pytest.raises(ValueError, match=r"conditions\.1"):
        Expect(conditions=("speed >= 1 m/s", "speed is nice"))
