"""Several nodes in one process: the same steps, with neither the wire nor a change of process between them.

Options: ``nodes``, a list in the order of the turns; each has ``name``, ``module`` and ``options`` as in a process
of its own. A message from one node of the process to another is handed over as it is; others hear it over Zenoh.
The nodes share one heartbeat. They also share their end: an error in one ends all of them, and the vehicle
process then stops the car.
"""

import importlib
from collections.abc import Callable
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any, cast

from pydantic import Field

from trepid.config import Settings
from trepid.messages import Health
from trepid.processes.process import Process, Values, process
from trepid.processes.turns import NodeModule, repeat

SEVERITY = list(Health)


class FusedNode(Settings):
    """One node of a fused process."""

    name: str
    module: str
    options: dict[str, Any] = Field(default_factory=dict)


class Heartbeats:
    """The one heartbeat of several nodes: the worst health, all messages, all values."""

    def __init__(self, me: Process) -> None:
        self._me = me
        self._states: dict[str, tuple[Health, str]] = {}
        self._values: list[Callable[[], Values]] = []

    def part(self, spec: FusedNode) -> Process:
        """The process as the node ``spec`` sees it."""

        def stepped(health: Health = Health.OK, message: str = "") -> None:
            self._states[spec.name] = health, message
            self._me.stepped(*self._state())

        def alive(health: Health = Health.OK, message: str = "") -> None:
            self._states[spec.name] = health, message
            self._me.alive(*self._state())

        part = SimpleNamespace(
            name=spec.name,
            options={**self._me.options, **spec.options},  # those of the drive, and its own
            bus=self._me.bus,
            now_s=self._me.now_s,
            running=self._me.running,
            ready=lambda *, values=tuple: self._values.append(values),
            stepped=stepped,
            alive=alive,
        )
        return cast(Process, part)

    def values(self) -> Values:
        """The values of all nodes."""
        return tuple(value for values in self._values for value in values())

    def _state(self) -> tuple[Health, str]:
        health = max((state for state, _ in self._states.values()), key=SEVERITY.index)
        said = [f"{name}: {message}" for name, (_, message) in self._states.items() if message]
        return health, "; ".join(said)


def run(me: Process) -> None:
    """Let the nodes of the options take turns until the process is to stop. Raises InputError."""
    heartbeats = Heartbeats(me)
    with ExitStack() as stack:
        nodes = []
        for options in me.options["nodes"]:
            spec = FusedNode.model_validate(options)
            module = cast(NodeModule, importlib.import_module(spec.module))
            nodes.append(stack.enter_context(module.node(heartbeats.part(spec))))
        me.ready(values=heartbeats.values)
        repeat(me, *nodes)


if __name__ == "__main__":
    with process() as me:
        run(me)
