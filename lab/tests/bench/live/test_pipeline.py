"""The figures of the pipeline benchmark, computed from what its drives and processes report."""

from typing import Any

import pytest

from lab.bench.live.overload import _ages
from lab.bench.live.pipeline import _load, _transport, in_one_process, in_real_time
from trepid.processes.settings import ProcessSpec

SPECS = tuple(
    ProcessSpec(name, module)
    for name, module in (
        ("vehicle", "sim_harness.live.vehicle_node"),
        ("camera", "sim_harness.live.camera_node"),
        ("cv", "perception.node"),
        ("lead", "perception.lead.node"),
        ("supervisor", "supervisor.node"),
        ("controller", "controller.node"),
    )
)


def transport(p50: float) -> dict[str, Any]:
    return {"transport": {"p50": p50, "p99": 2 * p50, "max": 3 * p50}}


def drive(image_ms: float, bare_ms: float) -> dict[str, Any]:
    bare = {"p50": bare_ms, "p99": 2 * bare_ms, "max": 3 * bare_ms}
    return {
        "stages": {"cv": transport(image_ms), "cnn": transport(image_ms), "supervisor": transport(0.0)},
        "ping": {"image": bare, "message": bare},
        "cpu": {"cv": 10.0, "camera": 30.0, "launcher": 4.0},
    }


def test_the_vehicle_ahead_takes_its_turn_after_the_command_in_one_process() -> None:
    frame = in_one_process(SPECS)[-1]
    names = [node["name"] for node in frame.options["nodes"]]
    assert names == ["cv", "supervisor", "controller", "lead"]


def test_neither_simulator_nor_lead_detector_runs_in_real_time() -> None:
    given = {spec.name for spec in in_real_time(SPECS) if "realtime" in spec.options}
    assert given == {"cv", "supervisor", "controller"}


def test_transport_is_compared_with_the_ping_of_its_own_run() -> None:
    found = _transport([drive(1.0, 1.0), drive(4.0, 2.0)])
    assert found["image, ratio p50"] == pytest.approx(1.5)
    assert found["image, p50 [ms]"] == pytest.approx(2.5)


def test_messages_that_are_handed_over_have_no_transport() -> None:
    assert _transport([drive(1.0, 1.0)])["message, ratio p50"] is None


def test_the_load_counts_neither_simulator_nor_launcher() -> None:
    assert _load([drive(1.0, 1.0)])["without simulator and launcher"] == pytest.approx(10.0)


def test_a_lag_that_grows_is_told_from_one_that_does_not() -> None:
    frames = [0.05 * n for n in range(20)]
    queue = _ages([(t_s, 2 * t_s, 2 * t_s + 0.1) for t_s in frames], 0.05)
    latest = _ages([(t_s, t_s + 0.02, t_s + 0.12) for t_s in frames], 0.05)
    assert queue["growth of the lag [s/s]"] == pytest.approx(0.5)
    assert latest["growth of the lag [s/s]"] == pytest.approx(0.0, abs=1e-6)
    assert latest["waiting p99 [periods]"] == pytest.approx(0.4)
