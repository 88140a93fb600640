"""Perception process: one estimator (and, for one of them, the judge of the image) on every new camera frame."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from perception.estimators import build
from trepid.messages import SteeringEstimate
from trepid.processes.journal import Journal, Timekeeper
from trepid.processes.process import Process
from trepid.processes.turns import serve
from trepid.topics import CAMERA_IMAGE, IMAGE_STATISTICS, VEHICLE_STATE, estimate_topic

if TYPE_CHECKING:
    from perception.sight.judge import ImageJudge

IDLE_S = 0.1  # without frames
UNREADABLE = "the newest frame is malformed, or the clock of its camera has stepped back"


class EstimatorNode:
    """Estimates on the newest frame and publishes. Frames are not queued.

    A frame that cannot be used is reported at once, by an estimate whose confidence is NaN: a broken one.
    """

    def __init__(self, me: Process) -> None:
        name = me.options["estimator"]
        self._me = me
        self._frames = me.bus.latest(CAMERA_IMAGE)
        self._state = me.bus.latest(VEHICLE_STATE, wakes=False)
        self._send_estimate = me.bus.publisher(estimate_topic(name))
        self._send_statistics = me.bus.publisher(IMAGE_STATISTICS)
        self._estimator = build(name, network=me.options.get("network"))
        self._judge = _build_judge() if me.options["statistics"] else None
        outputs = (estimate_topic(name), *((IMAGE_STATISTICS,) if self._judge else ()))
        self._journal = Journal(me, *outputs, reads=(self._frames, self._state))
        self._times = Timekeeper(me.bus, name, me.now_s)
        self._last: SteeringEstimate | None = None
        me.ready()

    def due_s(self) -> float:
        """Time between heartbeats without frames."""
        return IDLE_S

    def turn(self) -> None:
        """Estimate on a new frame."""
        frame, me = self._frames.take(), self._me
        if frame is None:
            self._report_broken()
            me.alive()
            return
        began_s = me.now_s()
        state = self._state.refresh()
        started_s = time.perf_counter()
        estimate = self._estimator.step(frame, state, now_s=began_s)
        latency_ms = 1e3 * (time.perf_counter() - started_s)
        self._last = replace(estimate, latency_ms=latency_ms)
        self._send_estimate(self._last)
        self._times.note(frame.t_s, self._frames, began_s=began_s)
        if self._judge is not None:  # after the estimate, which makes the supervisor decide
            self._send_statistics(self._judge.step(frame, self._last, state, now_s=began_s))
        self._journal.note(began_s)
        me.count_step()

    def _report_broken(self) -> None:
        """Publish a broken estimate of the last frame, once until the next frame."""
        if self._last is None or not self._frames.broken:
            return
        nothing = SteeringEstimate.nothing(
            self._last.t_s,
            estimator=self._last.estimator,
            lookahead_m=self._last.lookahead_m,
            reason=UNREADABLE,
            kind=self._last.kind,
        )
        self._send_estimate(replace(nothing, confidence=math.nan))
        self._last = None


def _build_judge() -> "ImageJudge":
    """The judge of the image, imported in the process that runs it only."""
    from perception.sight.judge import build as build_judge

    return build_judge()


@contextmanager
def node(me: Process) -> Iterator[EstimatorNode]:
    """The node of the estimator that the options name."""
    import cv2

    cv2.setNumThreads(1)
    yield EstimatorNode(me)


if __name__ == "__main__":
    serve(node)
