"""Causes of late messages."""

import pytest

from supervisor.inputs.watchdog import cause_of_lateness
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
