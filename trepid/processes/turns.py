"""The loop of a process: wait until a message or a time makes a turn due, then let every node take its turn.

Usually a process holds one node. Several in one process (:mod:`trepid.processes.fused`) take their turns one after
the other, in the order of the data flow, so that the output of one is there at the turn of the next.
"""

import gc
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from trepid.processes.process import Process, process


class Node(Protocol):
    """The shell of one step: reads the newest messages, steps, publishes."""

    def due_s(self) -> float:
        """Longest time to the next turn if no message arrives [s]."""
        ...

    def turn(self) -> None:
        """Step and publish if a message or the time makes it due, else return at once."""
        ...


class NodeModule(Protocol):
    """A module whose node can share a process with others."""

    def node(self, me: Process) -> AbstractContextManager[Node]:
        """The node, ready for its first turn."""
        ...


def repeat(me: Process, *nodes: Node) -> None:
    """Let ``nodes`` take turns until the process is to stop."""
    gc.collect()
    gc.freeze()  # later collections, which stop the process, skip the objects that exist now
    while me.running():
        me.bus.wait(timeout_s=max(0.0, min(node.due_s() for node in nodes)))
        for node in nodes:
            node.turn()


def serve(node: Callable[[Process], AbstractContextManager[Node]]) -> None:
    """Run ``node`` as a process of its own until the process is to stop."""
    with process() as me, node(me) as own:
        repeat(me, own)
