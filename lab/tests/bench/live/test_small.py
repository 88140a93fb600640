"""The RC car beside other work: what the row of a drive says."""

from typing import Any

import pytest

from lab.bench.live import small

ROW: dict[str, Any] = {
    "status": "passed",
    "causes": {"none": 20.0, "lost_estimator": 0.256},
    "engaged_percent": 99.0,
    "distance_m": 28.04,
    "latency_ms": {
        "frame_to_cv": {"p50": 3.0},
        "frame_to_arcs": None,
        "frame_to_command": {"p50": 5.0, "p99": 9.0},
    },
    "processes": {
        "cv": {"rate_hz": 20.0, "cpu_percent": 12.0},
        "arcs": {"rate_hz": None, "cpu_percent": None},
        "controller": {"rate_hz": 50.0, "cpu_percent": 8.0},
    },
}


def test_processor_time_of_a_frame_is_the_share_of_a_core_over_the_rate_and_absent_without_frames() -> None:
    assert small.frame_times(ROW) == {"cv": pytest.approx(6.0), "arcs": None}


def test_a_row_has_the_time_without_an_estimator_also_where_it_is_none() -> None:
    row = small.drive_row(ROW, 0.31)
    assert (row["lost estimator [s]"], row["load average before"]) == (0.26, 0.3)
    assert row["frame to command, p99 [ms]"] == 9.0
    calm = small.drive_row(
        {**ROW, "causes": {}, "latency_ms": {**ROW["latency_ms"], "frame_to_command": None}}, 0.0
    )
    assert (calm["lost estimator [s]"], calm["frame to command, p50 [ms]"]) == (0.0, None)


def test_the_drive_is_repeated_at_every_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(small, "_drive", lambda car, folder, load: (ROW, float(load)))
    rows = small.bench_rc()
    assert [row["load average before"] for row in rows["drives"].values()] == [0.0, 4.0]
    assert rows["share of a core [%]"]["load 4"]["controller"] == 8.0
