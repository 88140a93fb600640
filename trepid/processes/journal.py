"""The inputs of every step of a node, published once a second as :class:`~trepid.messages.Steps`.

A node reads the newest message of each topic when it steps. The times of publication in a recording do not give
which message that was, because messages arrive while a step waits for the processor. The journal states it, so that
`trepid replay` repeats each step with the same inputs.
"""

import math
from collections.abc import Sequence
from typing import Any

from trepid.bus import Latest
from trepid.messages import Steps
from trepid.processes.process import Process
from trepid.topics import STEPS, Topic

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
