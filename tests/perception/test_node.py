"""The process of an estimator."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from perception.node import EstimatorNode
from trepid.clock import UNSTAMPED
from trepid.messages import Frame
from trepid.topics import CAMERA_IMAGE, IMAGE_STATISTICS, VEHICLE_STATE, estimate_topic

FRAME = Frame(t_s=5.0, image=np.full((240, 320, 3), 90, np.uint8))


def published(*, statistics: bool) -> list[tuple[str, float]]:
    """Keys of what the node publishes after one frame, in order, with the capture times."""
    sent: list[tuple[str, Any]] = []
    inputs = {CAMERA_IMAGE.key: FRAME, VEHICLE_STATE.key: None}

    def latest(topic: Any, wakes: bool = True) -> Any:
        message = inputs[topic.key]
        given = dict(message=message, received_s=5.0, stamp=UNSTAMPED, broken=False)
        return SimpleNamespace(**given, take=lambda: message, refresh=lambda: message)

    me: Any = SimpleNamespace(
        name="cv",
        bus=SimpleNamespace(
            latest=latest, publisher=lambda topic: lambda message: sent.append((topic.key, message))
        ),
        options={"estimator": "cv", "statistics": statistics},
        now_s=lambda: 5.01,
        ready=lambda: None,
        stepped=lambda: None,
    )
    EstimatorNode(me).turn()
    known = {IMAGE_STATISTICS.key, estimate_topic("cv").key}
    return [(key, message.t_s) for key, message in sent if key in known]


@pytest.mark.parametrize("statistics", [True, False])
def test_the_statistics_of_a_frame_are_published_before_the_estimate_that_makes_the_supervisor_decide(
    statistics: bool,
) -> None:
    before = [(IMAGE_STATISTICS.key, 5.0)] if statistics else []
    assert published(statistics=statistics) == [*before, (estimate_topic("cv").key, 5.0)]
