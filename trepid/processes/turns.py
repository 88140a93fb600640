"""The loop of a process: wait until a message or a time makes a turn due, then let every node take its turn.

Usually a process holds one node. Several in one process (:mod:`trepid.processes.fused`) take their turns one after
the other, in the order of the data flow, so that the output of one is there at the turn of the next.
"""

import gc
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from trepid.messages import Health
from trepid.processes.process import Process, process


def prefer(priority: int | None) -> str:
    """Put all threads of this process into the real-time class SCHED_RR; None: leave them as they are.

    Returns why the system refuses, else "".
    """
    if priority is None:
        return ""
    try:
        for thread in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_RR, os.sched_param(priority))
    except OSError as error:
        return f"no real-time class: {error.strerror}; it needs CAP_SYS_NICE or RLIMIT_RTPRIO, and Linux"
    return ""


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


def repeat(me: Process, *nodes: Node, realtime: int | None = None) -> None:
    """Let ``nodes`` take turns until the process is to stop.

    ``realtime``, or else the option of this name of the process, is the priority, 1 to 99, of the real-time class
    that its threads get.
    """
    refused = prefer(me.options.get("realtime") if realtime is None else realtime)
    if refused:
        me.beat(Health.WARN, refused)
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
