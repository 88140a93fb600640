"""Frames that come twice as fast as the step can take them: a queue against latest-wins.

The step takes 0.1 s, as the network of Deep Steer did; its paper reports a lag that grows above 10 Hz. Both
subscriptions receive the same frames, in two processes that wait for the time of the step.
"""

import time
from typing import Any

import numpy as np

from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.messages import Frame
from trepid.processes.journal import Timekeeper
from trepid.processes.launch import Fleet
from trepid.processes.process import Process, Ticker, process
from trepid.processes.settings import ProcessSpec
from trepid.topics import CAMERA_IMAGE, DIAGNOSTICS, TIMING

STEP_S = 0.1
OVERLOAD = 2.0  # frames per step
DRIVE_S = 10.0
SHAPE = (240, 320, 3)
Row = dict[str, Any]


def overload() -> dict[str, Row]:
    """Age of the frame at the start of its step and behind its output, with a queue and with latest-wins."""
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    clock, period_s = epoch_clock(offset_ns), STEP_S / OVERLOAD
    specs = tuple(
        ProcessSpec(name, "lab.bench.live.overload", {"queue": name == "queue"})
        for name in ("queue", "latest")
    )
    times: dict[str, list[tuple[float, float, float]]] = {"queue": [], "latest": []}
    with (
        open_bus("overload", clock, listen=endpoint) as bus,
        Fleet(specs, vehicle_name="overload", endpoint=endpoint, clock_offset_ns=offset_ns) as fleet,
    ):
        reports, beats = bus.stream(TIMING), bus.stream(DIAGNOSTICS)
        send = bus.publisher(CAMERA_IMAGE)
        ready: set[str] = set()
        while len(ready) < len(fleet.children):
            bus.wait(0.05)
            ready.update(beat.process for beat, _ in beats.drain())
        image = np.zeros(SHAPE, np.uint8)
        ticker = Ticker(1 / period_s)
        for _ in range(round(DRIVE_S / period_s)):
            ticker.sleep()
            ticker.due()
            send(Frame(t_s=clock(), image=image))
        bus.wait(1.5)
        for report, _ in reports.drain():
            rows = zip(report.frame_s, report.began_s, report.sent_s, strict=True)
            times[report.process] += rows
    return {name: _ages(rows, period_s) for name, rows in times.items()}


def _ages(rows: list[tuple[float, float, float]], period_s: float) -> Row:
    """In periods of the camera: waiting of the frames for their step; age at the output; its growth [s/s]."""
    frames_s, began_s, sent_s = map(np.array, zip(*rows, strict=True))
    waiting, age = (began_s - frames_s) / period_s, (sent_s - frames_s) / period_s
    return {
        "waiting p50 [periods]": round(float(np.percentile(waiting, 50)), 2),
        "waiting p99 [periods]": round(float(np.percentile(waiting, 99)), 2),
        "age at output p99 [periods]": round(float(np.percentile(age, 99)), 2),
        "growth of the lag [s/s]": round(float(np.polyfit(sent_s - sent_s[0], sent_s - frames_s, 1)[0]), 3),
        "frames": len(rows),
    }


def run(me: Process) -> None:
    """Take frames, each for the time of the step, from a queue or the newest."""
    queue = me.options["queue"]
    frames = me.bus.stream(CAMERA_IMAGE) if queue else me.bus.latest(CAMERA_IMAGE)
    times = Timekeeper(me.bus, me.name, me.now_s)
    me.ready()
    while me.running():
        frame = frames.take()
        if frame is None:
            me.bus.wait(timeout_s=0.005)
            continue
        began_s = me.now_s()
        while me.now_s() - began_s < STEP_S:
            time.sleep(0.001)  # leaves the core to the other arm
        times.note(frame.t_s, frames, began_s=began_s)


if __name__ == "__main__":
    with process() as me:
        run(me)
