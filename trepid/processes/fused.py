"""Several nodes in one process: the same steps, with neither the wire nor a change of process between them.

Entries of ``processes.yaml`` with the same value of ``together`` become one process of that name
(:func:`gather_specs`); its nodes take turns in the order of the file. A message from one node of the process to
another is handed over as it is; others hear it over Zenoh. The nodes share one heartbeat. They also share their
end: an error in one ends all of them, and the vehicle process then stops the car. The process that publishes
``vehicle/state`` holds the limiter and is therefore never shared.
"""

import importlib
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from dataclasses import replace
from importlib.abc import InspectLoader
from types import SimpleNamespace
from typing import Any, cast

from pydantic import Field

from trepid.config import InputError, Settings
from trepid.messages import Health
from trepid.processes.process import Process, Values, process
from trepid.processes.realtime import OPTION
from trepid.processes.settings import RESERVED, ProcessSpec, missing_module, module_spec, published_keys
from trepid.processes.turns import NodeModule, repeat

FUSED = "trepid.processes.fused"
SEVERITY = list(Health)
OUTLIVES = "which stops the car when another node hangs or ends, so that it needs a process of its own"


class FusedNode(Settings):
    """One node of a fused process."""

    name: str
    module: str
    options: dict[str, Any] = Field(default_factory=dict)


def gather_specs(specs: Iterable[ProcessSpec]) -> tuple[ProcessSpec, ...]:
    """``specs`` with one process in place of those that share the value of ``together``.

    It is treated as the first of them is. Raises InputError for a program whose node cannot share a process, and
    for a shared process with the name of another one.
    """
    specs = tuple(specs)
    taken = {*RESERVED, *(spec.name for spec in specs)}
    found: dict[str, ProcessSpec] = {}
    for spec in specs:
        if not spec.together:
            found[spec.name] = spec
            continue
        problem = _unfit(spec, taken)
        if problem:
            where = f"{spec.place}: " if spec.place else ""
            raise InputError(f"{where}process {spec.name}: together: {spec.together}: {problem}")
        node = {"name": spec.name, "module": spec.module, "options": dict(spec.options)}
        whole = found.get(spec.together) or replace(
            spec, name=spec.together, module=FUSED, options={"nodes": []}, publishes=(), together=""
        )
        found[spec.together] = replace(
            whole,
            options={"nodes": [*whole.options["nodes"], node]},
            publishes=(*whole.publishes, *published_keys([spec])[spec.name]),
        )
    return tuple(found.values())


def _unfit(spec: ProcessSpec, taken: Collection[str]) -> str:
    """Why ``spec`` cannot share a process of a name that is not among ``taken``; "" when it can."""
    if spec.together in taken:
        return f"the shared process needs a name of its own, other than {', '.join(sorted(taken))}"
    if spec.is_vehicle:
        return f"it holds the limiter, {OUTLIVES}"
    if "\ndef node(" not in _source(spec.module):
        return f"{spec.program} has no function node(me), so that it needs a process of its own"
    return ""


def _source(module: str) -> str:
    """The text of ``module``; "" without one, and where its package cannot be imported."""
    found = module_spec(module) if module and not missing_module(module) else None
    loader = found.loader if found else None
    return (loader.get_source(module) or "") if isinstance(loader, InspectLoader) else ""


class Heartbeats:
    """The one heartbeat of several nodes: the worst health, all messages, all values."""

    def __init__(self, me: Process) -> None:
        self._me = me
        self._states: dict[str, tuple[Health, str]] = {}
        self._values: list[Callable[[], Values]] = []

    def part(self, spec: FusedNode) -> Process:
        """The interface of the process for the node ``spec``."""

        def count_step(health: Health = Health.OK, message: str = "") -> None:
            self._states[spec.name] = health, message
            self._me.count_step(*self._state())

        def alive(health: Health = Health.OK, message: str = "") -> None:
            self._states[spec.name] = health, message
            self._me.alive(*self._state())

        part = SimpleNamespace(
            name=spec.name,
            options={**self._me.options, **spec.options},  # those of the drive, and its own
            restarts=self._me.restarts,
            bus=self._me.bus,
            now_s=self._me.now_s,
            running=self._me.running,
            ready=lambda *, values=tuple: self._values.append(values),
            count_step=count_step,
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
        specs = [FusedNode.model_validate(options) for options in me.options["nodes"]]
        for spec in specs:
            module = cast(NodeModule, importlib.import_module(spec.module))
            nodes.append(stack.enter_context(module.node(heartbeats.part(spec))))
        priorities = filter(None, (spec.options.get(OPTION) for spec in specs))
        me.ready(values=heartbeats.values, realtime=max(priorities, default=None))
        repeat(me, *nodes)


if __name__ == "__main__":
    with process() as me:
        run(me)
