"""Timers: a stopwatch restarts after a break, a patience falls and recovers at the same rate."""

import pytest

from supervisor.inputs.timers import Patience, Stopwatch


def test_a_stopwatch_restarts_after_a_break() -> None:
    watch = Stopwatch()
    durations = [watch.step(now_s != 3.0, now_s=now_s) for now_s in (1.0, 2.0, 3.0, 4.0, 5.5)]
    assert durations == [0.0, 1.0, 0.0, 0.0, 1.5]


def times_out(causes: list[str], *, limit_s: float = 1.0, period_s: float = 0.1) -> int | None:
    """Index of the first decision at which patience ends."""
    patience = Patience()
    ended = [patience.lasts(c == "no_road", limit_s, now_s=period_s * n) for n, c in enumerate(causes)]
    return ended.index(True) if True in ended else None


def test_a_condition_that_holds_lasts_its_time() -> None:
    assert times_out(["no_road"] * 20) == 10
    assert times_out(["dark"] * 20) is None
    assert times_out([""] * 20) is None


def test_time_of_a_condition_that_comes_and_goes_accumulates_slowly() -> None:
    assert times_out(["no_road", "no_road", ""] * 20) in range(28, 35)
    assert times_out(["no_road", ""] * 50) is None


@pytest.mark.parametrize("limit_s", [0.5, 2.0])
def test_time_without_the_cause_reduces_the_patience_as_fast_as_it_grew(limit_s: float) -> None:
    n = round(limit_s / 0.1)
    causes = ["no_road"] * (10 * n) + [""] * n + ["no_road"] * (n - 1)
    patience = Patience()
    assert not [patience.lasts(c == "no_road", limit_s, now_s=0.1 * k) for k, c in enumerate(causes)][-1]


def test_a_pause_keeps_the_time() -> None:
    patience = Patience()
    for now_s in (0.0, 0.6):
        assert not patience.lasts(True, 1.0, now_s=now_s)
    assert not patience.lasts(False, 1.0, now_s=5.0, pause=True)
    assert patience.lasts(True, 1.0, now_s=5.4)
