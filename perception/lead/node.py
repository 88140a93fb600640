"""Lead process: the vehicle ahead in every new camera frame."""

import cv2

from perception.lead.finder import build
from trepid.processes.process import Process, process
from trepid.topics import CAMERA_IMAGE, LEAD_VEHICLE, VEHICLE_STATE, estimate_topic


def run(me: Process) -> None:
    """Publish the vehicle ahead in the newest frame."""
    frames, state = me.bus.latest(CAMERA_IMAGE), me.bus.latest(VEHICLE_STATE)
    lanes = [me.bus.latest(estimate_topic(name)) for name in me.options["estimators"]]
    send = me.bus.publisher(LEAD_VEHICLE)
    finder = build()
    me.ready()
    while me.running():
        me.bus.wait(timeout_s=0.1)
        me.alive()
        frame = frames.take()
        if frame is None:
            continue
        seen = [lane.refresh() for lane in lanes]
        send(finder.step(frame, state.refresh(), seen, now_s=me.now_s()))
        me.stepped()


if __name__ == "__main__":
    cv2.setNumThreads(1)
    with process() as me:
        run(me)
