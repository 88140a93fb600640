"""Perception process: one estimator (and, for one of them, the image statistics) on every new camera frame."""

import time
from dataclasses import replace

import cv2

from perception.camera.image_statistics import ImageStatistician
from perception.estimators import build
from trepid.processes.process import Process, process
from trepid.topics import CAMERA_IMAGE, IMAGE_STATISTICS, VEHICLE_STATE, estimate_topic


def run(me: Process) -> None:
    """Estimate on the newest frame and publish. Frames are not queued."""
    name = me.options["estimator"]
    frames, state = me.bus.latest(CAMERA_IMAGE), me.bus.latest(VEHICLE_STATE)
    send_estimate = me.bus.publisher(estimate_topic(name))
    send_statistics = me.bus.publisher(IMAGE_STATISTICS)
    estimator = build(name)
    statistician = ImageStatistician() if me.options["statistics"] else None
    me.ready()
    while me.running():
        me.bus.wait(timeout_s=0.1)
        me.alive()
        frame = frames.take()
        if frame is None:
            continue
        started_s = time.perf_counter()
        estimate = estimator.step(frame, state.refresh(), now_s=me.now_s())
        latency_ms = 1e3 * (time.perf_counter() - started_s)
        send_estimate(replace(estimate, latency_ms=latency_ms))
        if statistician is not None:
            send_statistics(statistician.step(frame, now_s=me.now_s()))
        me.stepped()


if __name__ == "__main__":
    cv2.setNumThreads(1)
    with process() as me:
        run(me)
