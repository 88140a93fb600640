"""The controller process passes to the step that the newest message of an input could not be decoded."""

from types import SimpleNamespace
from typing import Any

import pytest
from message_rig import decision, state

from controller.node import ControllerNode
from trepid.clock import UNSTAMPED
from trepid.messages import Command
from trepid.topics import COMMAND, DECISION, LOSSES, VEHICLE_STATE


def last_command(broken: str | None) -> Command:
    """The last of some commands when the newest message on the key ``broken`` is malformed from the first on."""
    now_s, sent = 0.0, list[Command]()
    inputs: dict[str, Any] = {
        key: SimpleNamespace(message=None, received_s=0.0, stamp=UNSTAMPED, broken=key == broken)
        for key in (DECISION.key, VEHICLE_STATE.key, LOSSES.key)
    }
    for one in inputs.values():
        one.take = one.refresh = lambda one=one: one.message
    me: Any = SimpleNamespace(
        name="controller",
        bus=SimpleNamespace(
            latest=lambda topic, wakes=True: inputs[topic.key],
            publisher=lambda topic: sent.append if topic is COMMAND else lambda _: None,
        ),
        now_s=lambda: now_s,
        ready=lambda *, values: None,
        count_step=lambda: None,
    )
    node = ControllerNode(me)
    for n in range(5):
        now_s = 0.02 * n
        inputs[DECISION.key].message = decision(now_s)
        inputs[VEHICLE_STATE.key].message = state(now_s, speed_mps=4.0)
        node.turn()
    return sent[-1]


@pytest.mark.parametrize("broken", [None, DECISION.key, VEHICLE_STATE.key])
def test_a_malformed_decision_or_state_brakes(broken: str | None) -> None:
    assert (last_command(broken).speed_mps > 0.0) is (broken is None)
