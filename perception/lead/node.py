"""Lead process: the vehicle ahead and the people in every new camera frame, after the estimates of the frame."""

from collections.abc import Iterator
from contextlib import contextmanager

from perception.lead.finder import build
from trepid.processes.journal import Journal, Timekeeper
from trepid.processes.process import Process
from trepid.processes.turns import serve
from trepid.topics import CAMERA_IMAGE, LEAD_VEHICLE, ROAD_USERS, VEHICLE_STATE, estimate_topic

IDLE_S = 0.1  # without estimates


class LeadNode:
    """Publishes the vehicle ahead in the newest frame, and with ``road_users`` people, cyclists and animals.

    It processes a frame when all estimates of it have arrived, so that the estimators get the processor first.
    Without estimates it processes the newest frame every IDLE_S.
    """

    def __init__(self, me: Process) -> None:
        self._me = me
        self._frames = me.bus.latest(CAMERA_IMAGE, wakes=False)
        self._state = me.bus.latest(VEHICLE_STATE, wakes=False)
        self._lanes = [me.bus.latest(estimate_topic(name)) for name in me.options["estimators"]]
        self._send = me.bus.publisher(LEAD_VEHICLE)
        outputs = (LEAD_VEHICLE, ROAD_USERS) if me.options.get("road_users", True) else (LEAD_VEHICLE,)
        self._send_users = me.bus.publisher(ROAD_USERS) if ROAD_USERS in outputs else None
        self._journal = Journal(me, *outputs, reads=(self._frames, self._state, *self._lanes))
        self._finder = build()
        self._times = Timekeeper(me.bus, me.name, me.now_s)
        self._looked_s = me.now_s()
        me.ready()

    def due_s(self) -> float:
        """Time to the next turn without estimates [s]."""
        return max(0.0, self._looked_s + IDLE_S - self._me.now_s())

    def turn(self) -> None:
        """Find the vehicle ahead in a new frame, if one is due."""
        began_s, me = self._me.now_s(), self._me
        came = [lane for lane in self._lanes if lane.take() is not None]
        frames = {lane.message.t_s if lane.message else None for lane in self._lanes}
        complete = bool(came) and len(frames) == 1
        if not complete and began_s - self._looked_s < IDLE_S:
            return
        self._looked_s = began_s
        frame = self._frames.take()
        if frame is None:
            me.alive()
            return
        seen = [lane.message for lane in self._lanes]
        self._send(self._finder.step(frame, self._state.refresh(), seen, now_s=began_s))
        if self._send_users is not None and self._finder.road_users is not None:
            self._send_users(self._finder.road_users)
        self._journal.note(began_s)
        if came:
            self._times.note(frame.t_s, came[-1], began_s=began_s)
        me.count_step()


@contextmanager
def node(me: Process) -> Iterator[LeadNode]:
    """The node of the lead detector."""
    import cv2

    cv2.setNumThreads(1)
    yield LeadNode(me)


if __name__ == "__main__":
    serve(node)
