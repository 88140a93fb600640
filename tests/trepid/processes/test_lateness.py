"""The next message of a sender is late some usual periods after the one before it."""

import math

import pytest

from trepid.processes.lateness import INTERVALS, RECOVERED, Lateness, LatenessLimits

LIMITS = LatenessLimits(periods=2.5, least_s=0.0625)


def after(period_s: float, messages: int = 6) -> tuple[Lateness, float]:
    """After a number of messages at a steady rate, and the time of the last one."""
    lateness = Lateness(LIMITS)
    for n in range(messages):
        lateness.step({"cv": n * period_s}, now_s=n * period_s)
    return lateness, (messages - 1) * period_s


@pytest.mark.parametrize("period_s", [0.03125, 0.125])
def test_the_limit_is_a_multiple_of_the_usual_period_of_the_sender(period_s: float) -> None:
    lateness, last_s = after(period_s)
    limit_s = last_s + 2.5 * period_s
    assert lateness.next_s == limit_s
    assert lateness.step({"cv": last_s}, now_s=limit_s - 0.001) == frozenset()
    assert lateness.step({"cv": last_s}, now_s=limit_s) == {"cv"}


def test_a_fast_sender_has_the_least_limit() -> None:
    lateness, last_s = after(0.0078125)
    assert lateness.next_s == last_s + LIMITS.least_s


def test_messages_in_time_end_the_lateness_and_one_long_gap_changes_no_period() -> None:
    lateness, last_s = after(0.03125)
    assert lateness.step({"cv": last_s}, now_s=last_s + 5.0) == {"cv"}
    assert lateness.next_s == math.inf  # it is late already
    back_s = last_s + 5.03125
    found = [
        lateness.step({"cv": t_s}, now_s=t_s) for t_s in (back_s + n * 0.03125 for n in range(RECOVERED + 1))
    ]
    assert found == [{"cv"}] * RECOVERED + [frozenset()]
    assert lateness.next_s == back_s + (RECOVERED + 2.5) * 0.03125


def test_a_sender_that_is_late_now_and_then_stays_late_until_this_is_usual() -> None:
    lateness, t_s = after(0.03125)
    found = []
    for n in range(2 * INTERVALS):
        t_s += 0.125 if n % 3 == 0 else 0.03125
        found.append(bool(lateness.step({"cv": t_s}, now_s=t_s)))
    assert found == [True] * INTERVALS + [False] * INTERVALS
    assert lateness.step({}, now_s=t_s + 0.125)  # the next one is late all the same


def test_a_message_that_lay_unread_counts_from_its_arrival_and_never_from_the_future() -> None:
    lateness, last_s = after(0.03125)
    came_s = last_s + 0.0078125
    lateness.step({"cv": came_s}, now_s=last_s + 0.03125, came_s={"cv": came_s})
    assert lateness.next_s == came_s + 2.5 * 0.03125
    for unknown_s in (math.nan, last_s + 100.0):
        lateness, last_s = after(0.03125)
        now_s = last_s + 0.03125
        lateness.step({"cv": now_s}, now_s=now_s, came_s={"cv": unknown_s})
        assert lateness.next_s == now_s + 2.5 * 0.03125


def test_a_repeated_older_or_broken_stamp_is_no_message() -> None:
    lateness, last_s = after(0.03125)
    limit_s = lateness.next_s
    for stamp_s in (last_s, last_s - 0.01, math.nan, math.inf):
        lateness.step({"cv": stamp_s}, now_s=last_s + 0.01)
        assert lateness.next_s == limit_s


def test_a_sender_without_a_usual_period_or_without_a_message_is_not_late() -> None:
    lateness, last_s = after(0.03125, messages=3)
    assert lateness.step({}, now_s=last_s + 10.0) == frozenset()
    assert lateness.next_s == math.inf
