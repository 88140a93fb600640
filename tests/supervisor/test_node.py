"""The supervisor process passes to the step the inputs whose newest message could not be decoded."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
from supervisor_rig import ESTIMATE, STATE, STATISTICS

from supervisor.node import SupervisorNode
from supervisor.rules.inference import FearRules
from supervisor.rules.reload import RuleChange
from supervisor.supervisor import build
from trepid.clock import UNSTAMPED, Stamp
from trepid.config import CONFIG_DIR
from trepid.messages import Health, Losses
from trepid.topics import (
    DECISION,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    LOSSES,
    ROAD_USERS,
    VEHICLE_STATE,
    estimate_topic,
)


@dataclass
class Input:
    """A subscription that has one message."""

    message: Any
    broken: bool = False
    received_s: float = 0.0
    stamp: Stamp = UNSTAMPED

    def take(self) -> Any:
        return self.message

    def refresh(self) -> Any:
        return self.message


def one_decision(
    broken: str | None = None, change: RuleChange | None = None, losses: Losses | None = None
) -> tuple[Any, list[Any]]:
    """The decision when the newest message on the key ``broken`` could not be decoded; values of two heartbeats."""
    inputs = {
        estimate_topic("cv").key: Input(ESTIMATE),
        estimate_topic("cnn").key: Input(replace(ESTIMATE, estimator="cnn")),
        IMAGE_STATISTICS.key: Input(STATISTICS),
        LEAD_VEHICLE.key: Input(None),
        ROAD_USERS.key: Input(None),
        VEHICLE_STATE.key: Input(STATE),
        LOSSES.key: Input(losses),
    }
    if broken is not None:
        inputs[broken].broken = True
    sent: list[Any] = []
    further: list[Any] = []
    bus = SimpleNamespace(
        latest=lambda topic, wakes=True: inputs[topic.key],
        publisher=lambda topic: sent.append if topic is DECISION else None,
    )
    me: Any = SimpleNamespace(
        name="supervisor",
        bus=bus,
        options={"estimators": ["cv", "cnn"]},
        now_s=lambda: 0.0,
        ready=lambda *, values: further.append(values),
        count_step=lambda health, message: None,
    )
    SupervisorNode(me, build(), SimpleNamespace(take=lambda: change)).turn()  # type: ignore[arg-type]
    return sent[0], [further[0](), further[0]()]


class Idle:
    """A node whose supervisor decides nothing, on a clock of its own."""

    def __init__(self, *, late_at_s: float = math.inf) -> None:
        self.now_s, self.decided, self.lead_sent_s = 0.0, 0, math.nan
        self.line_warning, self.beats = "", list[tuple[Health, str]]()
        self.inputs: dict[str, Any] = {}

        def latest(topic: Any, wakes: bool = True) -> Any:
            return self.inputs.setdefault(
                topic.key, SimpleNamespace(message=None, broken=False, stamp=UNSTAMPED)
            )

        def step(*_: object, **given: Any) -> Any:
            self.decided += 1
            self.lead_sent_s = given["lead_sent_s"]
            return SimpleNamespace(t_s=None, line_warning=self.line_warning)

        me: Any = SimpleNamespace(
            name="supervisor",
            bus=SimpleNamespace(latest=latest, publisher=lambda topic: lambda message: None),
            options={"estimators": ["cv"]},
            now_s=lambda: self.now_s,
            ready=lambda *, values: None,
            count_step=lambda health, message: self.beats.append((health, message)),
        )
        supervisor: Any = SimpleNamespace(step=step, late_at_s=late_at_s)
        self.node = SupervisorNode(me, supervisor, SimpleNamespace(take=lambda: None))  # type: ignore[arg-type]
        for one in self.inputs.values():
            one.take = one.refresh = lambda: None

    def turn_at(self, now_s: float) -> int:
        """Number of decisions after a turn at that time."""
        self.now_s = now_s
        self.node.turn()
        return self.decided


def test_it_decides_when_a_message_becomes_late_and_not_only_when_it_is_idle() -> None:
    idle = Idle(late_at_s=0.06)
    assert [idle.turn_at(t_s) for t_s in (0.0, 0.051)] == [0, 1]
    assert idle.node.due_s() == pytest.approx(0.009)
    assert [idle.turn_at(t_s) for t_s in (0.059, 0.061)] == [1, 2]


def test_the_publication_of_the_lead_reaches_the_step() -> None:
    idle = Idle()
    idle.inputs[LEAD_VEHICLE.key].stamp = Stamp(7, 0.02, b"lead")
    idle.turn_at(0.051)
    assert idle.lead_sent_s == 0.02


def test_it_decides_at_once_on_a_report_of_a_lost_process() -> None:
    idle = Idle()
    assert idle.turn_at(0.01) == 0
    idle.inputs[LOSSES.key].take = lambda: Losses(t_s=0.01, stop=("camera",), slow=())
    assert idle.turn_at(0.011) == 1


def test_the_heartbeat_says_the_warning_before_a_line_which_is_no_fault_of_the_process() -> None:
    idle = Idle()
    for t_s, idle.line_warning in ((0.051, ""), (0.102, "left"), (0.153, "")):
        idle.turn_at(t_s)
    words = "a wheel is about to cross the left edge of the lane"
    assert idle.beats == [(Health.OK, ""), (Health.OK, words), (Health.OK, "")]


@pytest.mark.parametrize(
    "topic",
    [estimate_topic("cv"), estimate_topic("cnn"), IMAGE_STATISTICS, LEAD_VEHICLE, ROAD_USERS, VEHICLE_STATE],
)
def test_a_malformed_message_on_any_input_raises_fear_to_one(topic: Any) -> None:
    assert one_decision()[0].fear < 0.5
    assert one_decision(broken=topic.key)[0].fear == 1


def test_adopted_rules_are_reported_by_one_heartbeat() -> None:
    change = RuleChange(FearRules.load(CONFIG_DIR / "fear.yaml"), "", "the text")
    assert one_decision(change=change)[1] == [(("rules_from_s", "0.0"), ("rules", "the text")), ()]
    assert one_decision(change=RuleChange(None, "refused"))[1] == [(), ()]
