"""The process of an estimator."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn_road_rig import road
from segment_rig import write_network_of_car

from perception.node import EstimatorNode
from trepid.clock import UNSTAMPED
from trepid.messages import Frame
from trepid.topics import CAMERA_IMAGE, IMAGE_STATISTICS, estimate_topic

FRAME = Frame(t_s=5.0, image=np.full((240, 320, 3), 90, np.uint8))


class Frames:
    """The subscription of the images, which gives ``next`` at every turn."""

    received_s, stamp, message = 5.0, UNSTAMPED, FRAME

    def __init__(self) -> None:
        self.next: Frame | None = FRAME
        self.broken = False

    def take(self) -> Frame | None:
        return self.next


def running(
    estimator: str = "cv", *, statistics: bool = False
) -> tuple[EstimatorNode, Frames, list[tuple[str, Any]]]:
    """A node of ``estimator``, its images, and the keys and messages that it publishes."""
    sent: list[tuple[str, Any]] = []
    known = {IMAGE_STATISTICS.key, estimate_topic(estimator).key}
    frames = Frames()
    state = SimpleNamespace(message=None, stamp=UNSTAMPED, broken=False, refresh=lambda: None)

    def publisher(topic: Any) -> Any:
        return lambda message: sent.append((topic.key, message)) if topic.key in known else None

    me: Any = SimpleNamespace(
        name=estimator,
        bus=SimpleNamespace(
            latest=lambda topic, wakes=True: frames if topic is CAMERA_IMAGE else state, publisher=publisher
        ),
        options={"estimator": estimator, "statistics": statistics},
        now_s=lambda: 5.01,
        ready=lambda: None,
        count_step=lambda: None,
        alive=lambda: None,
    )
    return EstimatorNode(me), frames, sent


def test_a_frame_that_cannot_be_used_is_reported_once_as_a_broken_estimate_of_the_last_one() -> None:
    node, frames, sent = running()
    node.turn()
    _, good = sent.pop()
    assert 0 <= good.confidence <= 1
    frames.broken, frames.next = True, None
    for _ in range(3):
        node.turn()
    ((_, broken),) = sent
    assert math.isnan(broken.confidence) and broken.lateral_offset_m is None and broken.reason
    assert (broken.t_s, broken.estimator, broken.kind) == (good.t_s, good.estimator, good.kind)
    frames.broken, frames.next = False, FRAME
    node.turn()
    again = sent[-1][1]
    assert (again.t_s, again.lateral_offset_m) == (good.t_s, good.lateral_offset_m)


def test_without_a_frame_so_far_nothing_is_reported() -> None:
    node, frames, sent = running()
    frames.broken, frames.next = True, None
    node.turn()
    assert sent == []


@pytest.mark.parametrize("statistics", [True, False])
def test_the_estimate_that_makes_the_supervisor_decide_does_not_wait_for_the_statistics_of_its_frame(
    statistics: bool,
) -> None:
    node, _, sent = running(statistics=statistics)
    node.turn()
    after = [(IMAGE_STATISTICS.key, 5.0)] if statistics else []
    assert [(key, message.t_s) for key, message in sent] == [(estimate_topic("cv").key, 5.0), *after]


def test_the_process_of_segments_publishes_its_lane_and_reports_a_broken_frame_as_others_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network_of_car(tmp_path)
    monkeypatch.setenv("TREPID_CAR", str(tmp_path))
    node, frames, sent = running("segments")
    frames.next = Frame(t_s=5.0, image=road((0.2, 0.0, 0.0, 0.0)))
    node.turn()
    frames.broken, frames.next = True, None
    node.turn()
    (key, lane), (_, broken) = sent
    assert key == estimate_topic("segments").key and lane.latency_ms > 0
    assert lane.lateral_offset_m == pytest.approx(0.2, abs=0.1) and lane.confidence > 0.5
    assert broken.estimator == "segments" and math.isnan(broken.confidence)
