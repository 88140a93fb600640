"""Every score against a value worked out by hand."""

import math

import numpy as np
import pytest
from trace_rig import trace_of, truth

from sim_harness.judging.comfort import max_lateral_jerk_mps3
from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import Trace
from trepid.config import InputError
from trepid.messages import Decision, Mode, Stop


def decision(fear, mode=Mode.KEEP, cause="none"):
    return Decision(
        t_s=0.0,
        decided_s=0.0,
        mode=mode,
        stop=Stop.NONE,
        fear=fear,
        level="low",
        cause=cause,
        rules=(),
        rule_strengths=(),
        inputs=(),
        input_values=(),
        path_t_s=None,
        lateral_offset_m=None,
        heading_error_rad=None,
        curvature_1pm=None,
        curvature_rate_1pm2=None,
        lookahead_m=0.0,
        path_source="none",
        sources=(),
        trust=(),
        disagreement_mps2=None,
        speed_factor=1.0,
        speed_cap_mps=10.0,
    )


def test_distance_speed_and_duration_come_from_the_station():
    scores = measure(
        trace_of([truth(2.0, station_m=30.0), truth(3.0, station_m=38.0), truth(6.0, station_m=70.0)])
    )
    assert (scores.duration_s, scores.distance_m, scores.mean_speed_mps) == (4.0, 40.0, 10.0)


def test_lateral_error_is_weighted_by_the_time_it_held():
    scores = measure(
        trace_of(
            [
                truth(0.0, lateral_offset_m=-0.4),
                truth(3.0, lateral_offset_m=0.2),
                truth(4.0, lateral_offset_m=0.1),
            ]
        )
    )
    assert scores.max_lateral_error_m == 0.4
    assert scores.rms_lateral_error_m == pytest.approx(math.sqrt((3 * 0.16 + 1 * 0.04) / 4))


def test_autonomy_loses_six_seconds_per_intervention():
    def scores(end_s, **counts):
        ends = [truth(0.0), truth(end_s, station_m=9.0, **counts)]
        return measure(trace_of(ends, [decision(0.0)] * 2))

    found = scores(100.0, interventions=2, departures=1, collisions=3)
    assert found.autonomy_percent == pytest.approx(88.0)
    assert (found.departures, found.interventions, found.collisions) == (1, 2, 3)
    assert scores(5.0, interventions=1).autonomy_percent == 0.0


def test_a_car_that_stood_or_was_never_engaged_has_no_autonomy():
    ends = [truth(0.0), truth(5.0, station_m=9.0)]
    stopped = [decision(0.0, Mode.STOP, "starting")] * 2
    assert measure(trace_of(ends, stopped)).autonomy_percent is None
    assert measure(trace_of([truth(0.0), truth(5.0)], [decision(0.0)] * 2)).autonomy_percent is None


def test_the_engaged_share_is_weighted_by_time_and_the_last_stop_names_its_cause():
    course = [
        (0.0, Mode.STOP, "starting"),
        (1.0, Mode.KEEP, "none"),
        (7.0, Mode.STOP, "dark"),
        (10.0, Mode.STOP, "none"),
    ]
    scores = measure(
        trace_of([truth(t_s) for t_s, *_ in course], [decision(0.0, *rest) for _, *rest in course])
    )
    assert (scores.engaged_percent, scores.stop_cause) == (60.0, "dark")
    scores = measure(trace_of([truth(0.0), truth(1.0)], [decision(0.0, *rest) for _, *rest in course[:2]]))
    assert (scores.engaged_percent, scores.stop_cause) == (0.0, None)


def test_accelerations_are_largest_magnitudes():
    scores = measure(
        trace_of(
            [
                truth(0.0, lateral_accel_mps2=-2.0, longitudinal_accel_mps2=1.0),
                truth(1.0, lateral_accel_mps2=1.5, longitudinal_accel_mps2=-2.5),
            ]
        )
    )
    assert (scores.max_lateral_accel_mps2, scores.max_decel_mps2) == (2.0, 2.5)
    assert measure(trace_of([truth(0.0), truth(1.0, longitudinal_accel_mps2=1.0)])).max_decel_mps2 == 0.0


def test_a_ramp_of_lateral_acceleration_has_its_slope_as_jerk():
    times = np.arange(0.0, 2.0, 0.01)
    samples = [truth(t, lateral_accel_mps2=-1.5 * t) for t in times]
    assert max_lateral_jerk_mps3(trace_of(samples)) == pytest.approx(1.5)


def test_a_step_of_lateral_acceleration_is_spread_over_half_a_second():
    samples = [truth(t, lateral_accel_mps2=0.8 if t > 1.0 else 0.0) for t in np.arange(0.0, 2.0, 0.01)]
    assert max_lateral_jerk_mps3(trace_of(samples)) == pytest.approx(0.8 / 0.5)


def test_the_jump_of_an_intervention_is_no_jerk():
    samples = [
        truth(t, lateral_accel_mps2=2.0 if t > 1.0 else 0.0, interventions=int(t > 1.0))
        for t in np.arange(0.0, 2.0, 0.01)
    ]
    assert max_lateral_jerk_mps3(trace_of(samples)) == 0.0


def test_the_time_gap_is_gap_over_speed_and_null_without_a_lead():
    assert measure(trace_of([truth(0.0), truth(1.0)])).min_time_gap_s is None
    followed = [truth(0.0, lead_gap_m=20.0), truth(1.0, lead_gap_m=14.0), truth(2.0, lead_gap_m=16.0)]
    assert measure(trace_of(followed)).min_time_gap_s == pytest.approx(1.4)
    assert measure(trace_of([truth(0.0, lead_gap_m=-1.0), truth(1.0, lead_gap_m=3.0)])).min_time_gap_s == 0.0


def test_fear_modes_and_causes_are_counted_from_the_first_decision_on():
    truths = [truth(t) for t in (0.0, 1.0, 3.0, 4.0)]
    decisions = [
        None,
        decision(0.2),
        decision(0.8, Mode.STOP, "frozen camera"),
        decision(0.8, Mode.STOP, "frozen camera"),
    ]
    scores = measure(trace_of(truths, decisions))
    assert scores.modes == {"KEEP": 2.0, "STOP": 1.0}
    assert scores.causes == {"none": 2.0, "frozen camera": 1.0}
    assert scores.max_fear == 0.8
    assert scores.mean_fear == pytest.approx((2 * 0.2 + 1 * 0.8) / 3)


def test_fear_counts_from_the_start_of_driving_on():
    truths = [truth(t) for t in (0.0, 1.0, 3.0, 4.0, 5.0)]
    begins = decision(1.0, Mode.STOP, "starting")
    scores = measure(trace_of(truths, [None, begins, decision(0.3), decision(0.4), decision(0.3)]))
    assert (scores.max_fear, scores.mean_fear) == (0.4, pytest.approx(0.35))
    assert measure(trace_of(truths, [begins] * 5)).max_fear is None


def test_without_decisions_there_is_no_fear_to_score():
    scores = measure(trace_of([truth(0.0), truth(1.0)]))
    assert (scores.max_fear, scores.mean_fear, scores.modes) == (None, None, {})


@pytest.mark.parametrize("times_s", [[], [0.0], [1.0, 1.0]])
def test_a_trace_that_spans_no_time_cannot_be_scored(times_s):
    with pytest.raises(ValueError, match="cannot be scored"):
        measure(trace_of([truth(t_s) for t_s in times_s]))


def test_equal_runs_have_equal_hashes_and_one_bit_or_word_of_difference_shows():
    samples = [truth(0.0), truth(1.0, lateral_offset_m=0.1)]
    same = trace_of(samples).sha256
    assert trace_of(samples).sha256 == same
    nudged = [samples[0], truth(1.0, lateral_offset_m=np.nextafter(0.1, 1.0))]
    renamed = [truth(0.0, section="other"), samples[1]]
    assert len({same, trace_of(nudged).sha256, trace_of(renamed).sha256}) == 3


def test_a_saved_trace_reads_back_unchanged(tmp_path):
    trace = trace_of([truth(0.0), truth(1.0, x_m=3.0)])
    trace.save(tmp_path / "run.npz")
    assert Trace.load(tmp_path / "run.npz").sha256 == trace.sha256
    with np.load(tmp_path / "run.npz") as saved:
        assert saved["x_m"].tolist() == [0.0, 3.0]
        assert np.isnan(saved["lead_gap_m"]).all()
        assert saved["words.section"].tolist() == ["plain"]


@pytest.mark.parametrize("content", [None, b"", b"no zip", b"PK\x03\x04"])
def test_a_file_that_is_no_saved_trace_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "run.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.npz: is no saved trace"):
        Trace.load(path)
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(InputError, match="it has no column t_s"):
        Trace.load(tmp_path / "other.npz")
