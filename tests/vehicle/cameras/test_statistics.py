"""Exposure and gaps in the heartbeat."""

import numpy as np
import pytest

from trepid.messages import Frame
from vehicle.cameras.statistics import FrameStatistics, exposure


def statistics_of(times_s: list[float]) -> dict[str, str]:
    statistics = FrameStatistics()
    for t_s in times_s:
        statistics.add(Frame(t_s=t_s, image=np.full((48, 64, 3), 51, np.uint8)))
    return dict(statistics.values())


def test_a_regular_camera_misses_nothing() -> None:
    values = statistics_of([0.0, 0.04, 0.08, 0.12])
    assert values["gap_median_ms"] == values["gap_max_ms"] == "40.0"
    assert values["missing_frames"] == "0"


def test_a_gap_of_several_periods_counts_the_missing_frames() -> None:
    values = statistics_of([0.0, 0.04, 0.08, 0.20, 0.24, 0.28])
    assert (values["gap_max_ms"], values["missing_frames"]) == ("120.0", "2")


def test_missing_frames_add_up_and_gaps_begin_anew_at_every_heartbeat() -> None:
    statistics = FrameStatistics()
    times_s = iter([0.0, 0.04, 0.08, 0.16, 0.20, 0.24, 0.28])
    found = []
    for count in (4, 3):
        for _ in range(count):
            statistics.add(Frame(t_s=next(times_s), image=np.zeros((48, 64, 3), np.uint8)))
        found.append(dict(statistics.values()))
    assert [values["missing_frames"] for values in found] == ["1", "1"]
    assert found[1]["gap_max_ms"] == "40.0"


def test_without_frames_there_are_no_gaps_and_no_exposure() -> None:
    assert set(statistics_of([])) == {"missing_frames", "refused_frames"}


@pytest.mark.parametrize(
    ("level", "expected"),
    [(51, ("0.200", "0.000", "0.000")), (255, ("1.000", "1.000", "0.000")), (0, ("0.000", "0.000", "1.000"))],
)
def test_exposure_is_the_mean_and_the_shares_at_both_ends(level: int, expected: tuple[str, str, str]) -> None:
    values = dict(exposure(np.full((48, 64, 3), level, np.uint8)))
    assert (values["brightness"], values["over_exposed"], values["under_exposed"]) == expected
