"""Lost senders, and the causes of late messages."""

import math

import pytest
from supervisor_rig import SETTINGS

from supervisor.inputs.watchdog import Fault, Watchdog, cause_of_lateness
from trepid.causes import Cause


@pytest.mark.parametrize(
    ("late", "cause"),
    [
        ({"cv", "cnn", "statistics", "lead"}, Cause.STALE_DATA),
        ({"cv", "statistics"}, Cause.LOST_ESTIMATOR),
        ({"statistics", "lead"}, Cause.IMAGE_STATISTICS_LOST),
        ({"lead"}, Cause.LEAD_LOST),
        (set(), Cause.NONE),
    ],
)
def test_late_messages_have_one_cause(late: set[str], cause: Cause) -> None:
    assert cause_of_lateness(late, ("cv", "cnn")) is cause


def watch_ages(cv_ages_s: list[float], period_s: float = 0.04) -> list[Fault]:
    """The faults while the newest message of cv has these ages, and all others are fresh."""
    one = Watchdog(SETTINGS.validation, frames_s=10.0)
    return [
        one.step(
            {"cv": age_s, "cnn": 0.0},
            statistics_s=0.0,
            lead_s=None,
            state_s=0.0,
            state=None,
            now_s=n * period_s,
        )
        for n, age_s in enumerate(cv_ages_s)
    ]


@pytest.mark.parametrize("impossible", [1, 5])
def test_a_sender_with_a_few_impossible_times_is_not_lost(impossible: int) -> None:
    faults = watch_ages([0.0] * 10 + [math.inf] * impossible + [0.0] * 10)
    assert set(faults) == {Fault("", False)}


def test_a_sender_is_lost_when_it_has_sent_nothing_possible_for_lost_s() -> None:
    faults = watch_ages([0.0] * 10 + [math.inf] * 20)
    lost_after = round(SETTINGS.validation.lost_s / 0.04)
    assert [fault.lost for fault in faults[9:]] == [n > lost_after for n in range(21)]
    assert faults[-1] == Fault(Cause.LOST_ESTIMATOR, True, part="cv")


def test_a_sender_whose_messages_are_always_old_is_not_lost() -> None:
    assert not any(fault.lost for fault in watch_ages([0.0] + [0.4] * 100))
