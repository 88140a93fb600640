"""Controller process: a command at every decision and report of a lost process, and at least 50 times a second."""

from collections.abc import Iterator
from contextlib import contextmanager

from controller.controller import build
from trepid.processes.journal import Journal, Timekeeper
from trepid.processes.process import Process, Ticker
from trepid.processes.turns import serve
from trepid.topics import COMMAND, DECISION, LOSSES, VEHICLE_STATE

RATE_HZ = 50.0


class ControllerNode:
    """Commands on every new decision or loss of a process at once, and on every tick."""

    def __init__(self, me: Process) -> None:
        self._me = me
        self._decision = me.bus.latest(DECISION)
        self._state = me.bus.latest(VEHICLE_STATE, wakes=False)
        self._losses = me.bus.latest(LOSSES)
        self._send = me.bus.publisher(COMMAND)
        self._journal = Journal(me, COMMAND, reads=(self._decision, self._state, self._losses))
        self._controller = build()
        self._times = Timekeeper(me.bus, me.name, me.now_s)
        me.ready(values=self._controller.learner.values)
        self._ticker = Ticker(RATE_HZ)

    def due_s(self) -> float:
        """Time to the next tick."""
        return self._ticker.remaining_s()

    def turn(self) -> None:
        """Command on a new decision, on a loss or at a tick."""
        fresh = self._decision.take() is not None
        lost = self._losses.take() is not None
        if not (self._ticker.due() or fresh or lost):
            return
        began_s = self._me.now_s()
        decision, state = self._decision.message, self._state.refresh()
        command = self._controller.step(
            decision,
            state,
            now_s=began_s,
            malformed=self._decision.broken or self._state.broken,
            losses=self._losses.message,
        )
        self._send(command)
        self._journal.note(began_s)
        if fresh:
            self._times.note(command.t_s, self._decision, began_s=began_s)
        self._me.count_step()


@contextmanager
def node(me: Process) -> Iterator[ControllerNode]:
    """The node of the controller."""
    yield ControllerNode(me)


if __name__ == "__main__":
    serve(node)
