"""Controller process: a command at every decision and at least 50 times a second."""

from controller.controller import build
from trepid.processes.process import Process, Ticker, process
from trepid.topics import COMMAND, DECISION, VEHICLE_STATE

RATE_HZ = 50.0


def run(me: Process) -> None:
    """Command on every new decision at once, and on every tick."""
    decision, state = me.bus.latest(DECISION), me.bus.latest(VEHICLE_STATE)
    send = me.bus.publisher(COMMAND)
    controller = build()
    me.ready(values=controller.learner.values)
    ticker = Ticker(RATE_HZ)
    while me.running():
        me.bus.wait(timeout_s=ticker.remaining_s())
        fresh = decision.take() is not None
        if ticker.due() or fresh:
            send(controller.step(decision.message, state.refresh(), now_s=me.now_s()))
            me.stepped()


if __name__ == "__main__":
    with process() as me:
        run(me)
