"""Where the time of a frame goes: exposed, published, received, estimated, decided, commanded, applied.

Every process notes its own times on the shared clock and reports them once a second (:class:`Timekeeper`), so that
no time depends on the delay of a listener. :class:`FrameTimes` joins the reports by frame.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from trepid.bus import Bus, Latest
from trepid.clock import Clock
from trepid.messages import Timing
from trepid.topics import TIMING

REPORT_PERIOD_S = 1.0
DECIDES, COMMANDS, APPLIES = "supervisor", "controller", "vehicle"
"""Names of the processes behind the estimators."""
Summary = dict[str, float]


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


class FrameTimes:
    """The times of all frames of a drive by process, from their reports."""

    def __init__(self, estimators: Iterable[str]) -> None:
        self._estimators = tuple(estimators)
        self._times: dict[str, dict[float, Times]] = {}

    def add(self, report: Timing, *, from_s: float = -math.inf) -> None:
        """Add the frames of ``report`` that were captured from ``from_s`` on."""
        known = self._times.setdefault(report.process, {})
        rows = zip(report.published_s, report.received_s, report.began_s, report.sent_s, strict=False)
        for frame_s, (published_s, received_s, began_s, sent_s) in zip(report.frame_s, rows, strict=False):
            if frame_s >= from_s:
                stamped_s = math.nan if published_s is None else published_s
                known.setdefault(frame_s, Times(stamped_s, received_s, began_s, sent_s))

    def latency_ms(self) -> dict[str, Summary | None]:
        """From the publication of a frame to the output of each process, and from its exposure to the publication.

        ``exposed_to_published`` is the share of the camera; a simulated camera renders in it. ``frame_to_command``
        ends when the command is handed to the transport, ``frame_to_applied`` when the limiter has applied it.
        """
        ends = {f"frame_to_{name}": name for name in self._estimators}
        ends |= {"frame_to_decision": DECIDES, "frame_to_command": COMMANDS, "frame_to_applied": APPLIES}
        published = self._published()
        exposures = [t_s - frame_s for frame_s, t_s in published.items()]
        found: dict[str, Summary | None] = {"exposed_to_published": summary(exposures)}
        for name, process in ends.items():
            times = self._times.get(process, {})
            found[name] = summary(t.sent_s - published[f] for f, t in times.items() if f in published)
        return found

    def stages_ms(self) -> dict[str, dict[str, Summary | None]]:
        """For each process: transport of the message before, waiting for the step, the step with sending."""
        return {
            process: {
                "transport": summary(t.received_s - t.published_s for t in times.values()),
                "waiting": summary(t.began_s - t.received_s for t in times.values()),
                "step": summary(t.sent_s - t.began_s for t in times.values()),
            }
            for process, times in self._times.items()
        }

    def spread_ms(self) -> Summary | None:
        """Time from the first to the last estimate of a frame: the wait of a decision for all estimates."""
        of_all = [self._times.get(name, {}) for name in self._estimators]
        if not of_all:
            return None
        frames = set(of_all[0]).intersection(*of_all[1:])
        sent = ([times[frame].sent_s for times in of_all] for frame in frames)
        return summary(max(ends) - min(ends) for ends in sent)

    def _published(self) -> Mapping[float, float]:
        """Time of publication of each frame by its capture, as the estimators received it."""
        return {
            frame_s: times.published_s
            for name in self._estimators
            for frame_s, times in self._times.get(name, {}).items()
            if math.isfinite(times.published_s)
        }


def summary(durations_s: Iterable[float]) -> Summary | None:
    """Median, 99th percentile and maximum of the finite durations [ms]; None without any."""
    samples = np.fromiter(durations_s, float)
    samples_ms = 1e3 * samples[np.isfinite(samples)]
    if not samples_ms.size:
        return None
    p50, p99 = np.percentile(samples_ms, [50, 99])
    return {
        "p50": round(float(p50), 2),
        "p99": round(float(p99), 2),
        "max": round(float(samples_ms.max()), 2),
    }
