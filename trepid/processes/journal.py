"""What a node reports once a second about its own steps: their inputs, and when it handled each frame.

The inputs are :class:`~trepid.messages.Steps`, the times :class:`~trepid.messages.Timing`. A node reads the newest
message of each topic when it steps. The times of publication in a recording do not give which message that was,
because messages arrive while a step waits for the processor. The journal states it, so that `trepid replay` repeats
each step with the same inputs.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from trepid.bus import Bus, Latest
from trepid.clock import Clock
from trepid.messages import Steps, Timing
from trepid.processes.process import Process
from trepid.topics import STEPS, TIMING, Topic

REPORT_PERIOD_S = 1.0


class Journal:
    """The steps of one node since its last report."""

    def __init__(self, me: Process, *outputs: Topic[Any], reads: Sequence[Latest[Any]]) -> None:
        """Each step publishes ``outputs`` and uses the newest messages of ``reads``."""
        self._send = me.bus.publisher(STEPS)
        self._process = me.name
        self._outputs = tuple(topic.key for topic in outputs)
        self._reads = tuple(reads)
        self._first = 0
        self._began_s: list[float] = []
        self._read_s: list[float | None] = []
        self._broken: list[float] = []
        self._reported_s = me.now_s()

    def note(self, began_s: float) -> None:
        """Note the inputs of the step that was given ``began_s`` and whose output has just been sent."""
        self._began_s.append(began_s)
        for latest in self._reads:
            if latest.broken:
                self._broken.append(float(len(self._read_s)))
            published_s = math.nan if latest.message is None else latest.stamp.published_s
            self._read_s.append(None if math.isnan(published_s) else published_s)
        if began_s - self._reported_s >= REPORT_PERIOD_S:
            self._report(began_s)

    def _report(self, now_s: float) -> None:
        self._send(
            Steps(
                t_s=now_s,
                process=self._process,
                first=self._first,
                outputs=self._outputs,
                inputs=tuple(latest.topic.key for latest in self._reads),
                began_s=tuple(self._began_s),
                read_s=tuple(self._read_s),
                broken=tuple(self._broken),
            )
        )
        self._first += len(self._began_s)
        self._began_s, self._read_s, self._broken = [], [], []
        self._reported_s = now_s


class Times(NamedTuple):
    """When one process handled one frame [s]."""

    published_s: float  # NaN: the message had no stamp
    received_s: float
    began_s: float
    sent_s: float


class Timekeeper:
    """The times at which one node handles frames; published once a second."""

    def __init__(self, bus: Bus, process: str, now_s: Clock) -> None:
        self._send = bus.publisher(TIMING)
        self._process = process
        self._now_s = now_s
        self._rows: list[tuple[float, Times]] = []
        self._newest_s = -math.inf
        self._reported_s = now_s()

    def note(self, frame_s: float | None, trigger: Latest[Any], *, began_s: float) -> None:
        """Note the output for the frame captured at ``frame_s``, which has just been sent.

        ``trigger`` holds the message before. The first output for a frame counts; later ones repeat it.
        """
        sent_s = self._now_s()
        if frame_s is not None and frame_s > self._newest_s:
            self._newest_s = frame_s
            received_s = began_s if trigger.received_s is None else trigger.received_s
            self._rows.append((frame_s, Times(trigger.stamp.published_s, received_s, began_s, sent_s)))
        if self._rows and sent_s - self._reported_s >= REPORT_PERIOD_S:
            self._report(sent_s)

    def _report(self, now_s: float) -> None:
        self._reported_s = now_s
        rows, self._rows = self._rows, []
        self._send(
            Timing(
                t_s=now_s,
                process=self._process,
                frame_s=tuple(frame_s for frame_s, _ in rows),
                published_s=tuple(None if math.isnan(t.published_s) else t.published_s for _, t in rows),
                received_s=tuple(t.received_s for _, t in rows),
                began_s=tuple(t.began_s for _, t in rows),
                sent_s=tuple(t.sent_s for _, t in rows),
            )
        )
