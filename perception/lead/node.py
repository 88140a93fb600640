"""Lead process: the vehicle ahead in every new camera frame."""

from collections.abc import Iterator
from contextlib import contextmanager

from perception.lead.finder import build
from trepid.processes.process import Process, process
from trepid.processes.timing import Timekeeper
from trepid.processes.turns import repeat
from trepid.topics import CAMERA_IMAGE, LEAD_VEHICLE, VEHICLE_STATE, estimate_topic

IDLE_S = 0.1  # without frames


class LeadNode:
    """Publishes the vehicle ahead in the newest frame."""

    def __init__(self, me: Process) -> None:
        self._me = me
        self._frames = me.bus.latest(CAMERA_IMAGE)
        self._state = me.bus.latest(VEHICLE_STATE, wakes=False)
        self._lanes = [me.bus.latest(estimate_topic(name), wakes=False) for name in me.options["estimators"]]
        self._send = me.bus.publisher(LEAD_VEHICLE)
        self._finder = build()
        self._times = Timekeeper(me.bus, me.name, me.now_s)
        me.ready()

    def due_s(self) -> float:
        """Time between heartbeats without frames."""
        return IDLE_S

    def turn(self) -> None:
        """Look for the vehicle ahead in a new frame."""
        frame, me = self._frames.take(), self._me
        if frame is None:
            me.alive()
            return
        began_s = me.now_s()
        seen = [lane.refresh() for lane in self._lanes]
        self._send(self._finder.step(frame, self._state.refresh(), seen, now_s=began_s))
        self._times.note(frame.t_s, self._frames, began_s=began_s)
        me.stepped()


@contextmanager
def node(me: Process) -> Iterator[LeadNode]:
    """The node of the lead detector."""
    import cv2

    cv2.setNumThreads(1)
    yield LeadNode(me)


def run(me: Process) -> None:
    """Look for the vehicle ahead until the process is to stop."""
    with node(me) as looking:
        repeat(me, looking)


if __name__ == "__main__":
    with process() as me:
        run(me)
