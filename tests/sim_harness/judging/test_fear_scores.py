"""Was fear worth having? Scores against values counted by hand and by brute force."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_harness.judging.fear_scores import (
    auroc,
    fear_and_departure,
    fear_auroc,
    fear_lead_time_s,
    nuisance_slowdowns_per_km,
)
from sim_harness.judging.trace import USER_GAP, Trace

N = 200
T_S = 0.1 * np.arange(N)  # 20 s


def trace(**columns):
    values = {
        "decision.fear": 0.1,
        "decision.speed_factor": 1.0,
        "departures": 0.0,
        "interventions": 0.0,
        "collisions": 0.0,
        "speed_mps": 10.0,
        "station_m": 10.0 * T_S,
        "lead_gap_m": math.nan,
    } | {name.replace("__", "."): value for name, value in columns.items()}
    spread = {name: np.broadcast_to(np.asarray(v, float), N) for name, v in values.items()}
    return Trace({"t_s": T_S, **spread}, {})


def during(*spans, value=1.0, otherwise=0.0):
    """``value`` in each [from, to) seconds."""
    inside = np.zeros(N, bool)
    for start_s, end_s in spans:
        inside |= (start_s - 1e-6 < T_S) & (end_s - 1e-6 > T_S)
    return np.where(inside, value, otherwise)


def count_before(*times_s):
    return sum((at - 1e-6 < T_S).astype(float) for at in times_s)


def test_the_lead_time_is_how_long_fear_had_lasted_when_the_vehicle_left_its_lane():
    left = dict(departures=count_before(10.0), interventions=count_before(10.0))
    assert fear_lead_time_s(trace(**left, decision__fear=during((7.5, 10.0), value=0.6))) == pytest.approx(
        2.5
    )
    broken = during((5.0, 9.0), (9.2, 10.0), value=0.6)
    assert fear_lead_time_s(trace(**left, decision__fear=broken)) == pytest.approx(0.8)
    assert fear_lead_time_s(trace(**left)) == 0.0
    assert fear_lead_time_s(trace(decision__fear=0.9)) is None


def test_of_several_departures_the_worst_warned_counts_and_fear_of_the_last_one_is_no_warning():
    twice = dict(departures=count_before(10.0, 11.0), interventions=count_before(10.0, 11.0))
    assert fear_lead_time_s(trace(**twice, decision__fear=during((5.0, 11.0), value=0.9))) == pytest.approx(
        1.0
    )


def test_samples_within_three_seconds_of_a_departure_are_followed_by_it():
    fear, followed = fear_and_departure(trace(departures=count_before(10.0)))
    assert followed.sum() == 30  # 7.0 s up to 9.9 s
    assert len(fear) == 170  # up to the last 3 s, after which all may happen
    fear, followed = fear_and_departure(trace(departures=count_before(19.0)))
    assert (len(fear), followed.sum()) == (190, 30)  # but earlier events are known


def test_fear_of_a_vehicle_that_stands_is_neither_right_nor_wrong():
    stands = np.where(T_S < 14.95, 10.0, 0.0)
    fear, followed = fear_and_departure(trace(departures=count_before(10.0), speed_mps=stands))
    assert (len(fear), followed.sum()) == (150, 30)


def test_fear_only_before_departures_has_auroc_1_and_constant_fear_one_half():
    left = dict(departures=count_before(10.0))
    assert fear_auroc(trace(**left, decision__fear=during((7.0, 10.0), value=0.8))) == 1.0
    assert fear_auroc(trace(**left)) == 0.5
    assert fear_auroc(trace(**left, decision__fear=during((7.0, 10.0), value=0.1, otherwise=0.8))) == 0.0
    assert fear_auroc(trace(decision__fear=0.5)) is None
    # Of several runs the samples are pooled: 170 of the vain one tie with the 30 that a departure followed.
    calm, vain = trace(**left, decision__fear=during((7.0, 10.0), value=0.8)), trace(decision__fear=0.8)
    assert fear_auroc(calm, vain) == pytest.approx((140 + 170 / 2) / (140 + 170))


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), min_size=1, max_size=25))
def test_auroc_is_the_share_of_pairs_in_the_right_order(samples):
    scores = np.array([score for score, _ in samples], float)
    positive = np.array([flag for _, flag in samples])
    pairs = [(p > n) + 0.5 * (p == n) for p in scores[positive] for n in scores[~positive]]
    assert auroc(scores, positive) == (pytest.approx(np.mean(pairs)) if pairs else None)


SLOW = dict(
    decision__fear=during((8.0, 9.0), value=0.6),
    decision__speed_factor=during((8.0, 9.0), value=0.7, otherwise=1),
)


def test_a_slow_down_without_a_reason_is_a_nuisance():
    assert nuisance_slowdowns_per_km(trace(**SLOW)) == pytest.approx(1 / 0.199)
    assert nuisance_slowdowns_per_km(trace()) == 0.0
    assert nuisance_slowdowns_per_km(trace(station_m=5.0)) is None


@pytest.mark.parametrize(
    "reason",
    [
        {"departures": count_before(11.8)},
        {"interventions": count_before(5.1)},
        {"collisions": count_before(8.5)},
        {"fault__frozen_camera": during((2.0, 6.0))},
        {"disturbance__glare": during((11.0, 13.0), value=3.0)},
        {"lead_gap_m": during((8.0, 8.1), value=15.0, otherwise=50.0)},
        {USER_GAP: during((8.0, 8.1), value=15.0, otherwise=50.0)},
    ],
)
def test_a_slow_down_with_a_reason_within_three_seconds_is_no_nuisance(reason):
    assert nuisance_slowdowns_per_km(trace(**SLOW, **reason)) == 0.0


@pytest.mark.parametrize(
    "far",
    [
        {"departures": count_before(12.5)},
        {"fault__frozen_camera": during((2.0, 4.5))},
        {"lead_gap_m": 30.0},
        {USER_GAP: 30.0},
    ],
)
def test_an_event_long_before_or_after_does_not_justify_a_slow_down(far):
    assert nuisance_slowdowns_per_km(trace(**SLOW, **far)) > 0


def test_slow_downs_under_a_second_apart_count_as_one_and_mild_or_standing_ones_not_at_all():
    def slowdowns_per_km(*spans, fear=0.6, factor=0.7, **more):
        factors = during(*spans, value=factor, otherwise=1)
        return nuisance_slowdowns_per_km(
            trace(decision__fear=during(*spans, value=fear), decision__speed_factor=factors, **more)
        )

    assert slowdowns_per_km((8.0, 9.0), (9.5, 10.0)) == pytest.approx(1 / 0.199)
    assert slowdowns_per_km((8.0, 9.0), (11.0, 12.0)) == pytest.approx(2 / 0.199)
    assert slowdowns_per_km((8.0, 9.0), factor=0.95) == 0.0
    assert slowdowns_per_km((8.0, 9.0), fear=0.3) == 0.0
    assert slowdowns_per_km((0.0, 1.0), speed_mps=during((0.5, 20.0), value=5.0)) == 0.0
