"""The supervisor process passes to the step the inputs whose newest message could not be decoded."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
from supervisor_rig import ESTIMATE, STATE, STATISTICS

from supervisor.node import decide
from supervisor.supervisor import build
from trepid.topics import DECISION, IMAGE_STATISTICS, LEAD_VEHICLE, VEHICLE_STATE, estimate_topic


@dataclass
class Input:
    """A subscription that has one message."""

    message: Any
    broken: bool = False

    def take(self) -> Any:
        return self.message

    def refresh(self) -> Any:
        return self.message


def fear_of_one_decision(broken: str | None) -> float:
    """Fear when the newest message on the key ``broken`` could not be decoded."""
    inputs = {
        estimate_topic("cv").key: Input(ESTIMATE),
        estimate_topic("cnn").key: Input(replace(ESTIMATE, estimator="cnn")),
        IMAGE_STATISTICS.key: Input(STATISTICS),
        LEAD_VEHICLE.key: Input(None),
        VEHICLE_STATE.key: Input(STATE),
    }
    if broken is not None:
        inputs[broken].broken = True
    sent: list[Any] = []
    bus = SimpleNamespace(
        latest=lambda topic: inputs[topic.key],
        publisher=lambda topic: sent.append if topic is DECISION else None,
        wait=lambda timeout_s: True,
    )
    me: Any = SimpleNamespace(
        bus=bus,
        options={"estimators": ["cv", "cnn"]},
        now_s=lambda: 0.0,
        running=lambda: not sent,
        ready=lambda values: None,
        stepped=lambda health, message: None,
    )
    decide(me, build(), SimpleNamespace(take=lambda: None))  # type: ignore[arg-type]
    fear: float = sent[0].fear
    return fear


@pytest.mark.parametrize(
    "topic", [estimate_topic("cv"), estimate_topic("cnn"), IMAGE_STATISTICS, LEAD_VEHICLE, VEHICLE_STATE]
)
def test_a_malformed_message_on_any_input_raises_fear_to_one(topic: Any) -> None:
    assert fear_of_one_decision(None) < 0.5
    assert fear_of_one_decision(topic.key) == 1
