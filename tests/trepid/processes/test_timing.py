"""The times of a frame: noted by each process, joined by frame."""

from random import Random
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trepid.clock import UNSTAMPED
from trepid.messages import Timing
from trepid.processes.journal import REPORT_PERIOD_S, Timekeeper
from trepid.processes.timing import FrameTimes


def report(process: str, *rows: tuple[float, float | None, float, float, float]) -> Timing:
    frame_s, published_s, received_s, began_s, sent_s = zip(*rows, strict=True)
    return Timing(
        t_s=100.0,
        process=process,
        frame_s=frame_s,
        published_s=published_s,
        received_s=received_s,
        began_s=began_s,
        sent_s=sent_s,
    )


CV = report("cv", (1.0, 1.004, 1.005, 1.006, 1.008), (2.0, 2.004, 2.005, 2.006, 2.008))
CNN = report("cnn", (1.0, 1.004, 1.005, 1.006, 1.010))
SUPERVISOR = report("supervisor", (1.0, 1.010, 1.011, 1.011, 1.012))


def times(*reports: Timing, from_s: float = 0.0) -> FrameTimes:
    found = FrameTimes(("cv", "cnn"))
    for one in reports:
        found.add(one, from_s=from_s)
    return found


def test_a_frame_is_timed_from_its_publication_and_its_rendering_stands_apart() -> None:
    latency_ms = times(CV, CNN, SUPERVISOR).latency_ms()
    assert latency_ms["exposed_to_published"] == pytest.approx({"p50": 4.0, "p99": 4.0, "max": 4.0})
    assert latency_ms["frame_to_decision"] == pytest.approx({"p50": 8.0, "p99": 8.0, "max": 8.0})
    assert latency_ms["frame_to_command"] is None


def test_transport_waiting_and_step_of_each_process_add_up_to_its_time() -> None:
    stages = times(CV).stages_ms()["cv"]
    assert [stage["p50"] for stage in stages.values() if stage] == pytest.approx([1.0, 1.0, 2.0])


def test_the_first_and_the_last_estimate_of_a_frame_are_compared_only_where_both_exist() -> None:
    assert times(CV, CNN).spread_ms() == pytest.approx({"p50": 2.0, "p99": 2.0, "max": 2.0})
    assert times(CV).spread_ms() is None


def test_frames_before_the_drive_do_not_count() -> None:
    latency_ms = times(CV, SUPERVISOR, from_s=1.5).latency_ms()
    assert latency_ms["frame_to_cv"] == pytest.approx({"p50": 4.0, "p99": 4.0, "max": 4.0})
    assert latency_ms["frame_to_decision"] is None


def test_the_figures_of_a_long_drive_are_those_of_all_its_frames_in_a_constant_memory() -> None:
    found = FrameTimes(("cv", "cnn"))
    sent: dict[str, list[float]] = {"cv": [], "cnn": [], "supervisor": []}
    dice = Random(1)
    sizes = []
    for second in range(600):
        frames = [second + n / 30 for n in range(30)]
        for process, after_s in (("cv", 0.004), ("cnn", 0.006), ("supervisor", 0.012)):
            took_s = [round(dice.expovariate(300), 5) for _ in frames]
            sent[process] += [after_s + t for t in took_s]
            rows = [
                (f, f + 0.002, f + 0.003, f + 0.003, f + 0.002 + after_s + t)
                for f, t in zip(frames, took_s, strict=True)
            ]
            found.add(report(process, *rows))
        if second in (60, 599):
            sizes.append(sum(map(len, found._times.values())))
    assert sizes[0] == sizes[1] < 3 * 30 * 7
    for name, process in (("frame_to_cv", "cv"), ("frame_to_decision", "supervisor")):
        p50, p99 = 1e3 * np.percentile(sent[process], [50, 99])
        assert found.latency_ms()[name] == pytest.approx(
            {"p50": p50, "p99": p99, "max": 1e3 * max(sent[process])}, abs=0.011
        )
    spread_ms = [1e3 * abs(a - b) for a, b in zip(sent["cv"], sent["cnn"], strict=True)]
    p50, p99 = np.percentile(spread_ms, [50, 99])
    assert found.spread_ms() == pytest.approx({"p50": p50, "p99": p99, "max": max(spread_ms)}, abs=0.011)
    assert found.stages_ms()["cv"]["transport"] == {"p50": 1.0, "p99": 1.0, "max": 1.0}


def test_a_frame_that_is_reported_after_it_was_counted_does_not_count_twice() -> None:
    found = times(CV, CNN)
    found.add(report("cv", (100.0, 100.004, 100.005, 100.006, 100.050)))
    found.add(CV)
    assert found.latency_ms()["frame_to_cv"] == pytest.approx(
        {"p50": 4.0, "p99": 45.16, "max": 46.0}, abs=0.1
    )


def test_a_message_without_a_stamp_has_no_transport_time_but_a_step() -> None:
    stages = times(report("cv", (1.0, None, 1.005, 1.006, 1.008))).stages_ms()["cv"]
    assert stages["transport"] is None
    assert stages["step"] == pytest.approx({"p50": 2.0, "p99": 2.0, "max": 2.0})


def test_a_process_reports_the_first_output_for_each_frame_once_a_second() -> None:
    sent: list[Timing] = []
    now_s = [10.0]
    bus: Any = SimpleNamespace(publisher=lambda topic: sent.append)
    keeper = Timekeeper(bus, "controller", lambda: now_s[0])
    trigger: Any = SimpleNamespace(received_s=9.9, stamp=UNSTAMPED._replace(published_s=9.8))
    for frame_s in (9.7, 9.7, None, 9.75):
        now_s[0] += 0.01
        keeper.note(frame_s, trigger, began_s=9.95)
    assert not sent
    now_s[0] += REPORT_PERIOD_S
    keeper.note(9.75, trigger, began_s=9.95)
    (message,) = sent
    assert (message.process, message.frame_s, message.published_s) == ("controller", (9.7, 9.75), (9.8, 9.8))
    assert message.sent_s == pytest.approx((10.01, 10.04))
