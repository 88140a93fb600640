"""Where the time of a frame goes: exposed, published, received, estimated, decided, commanded, applied.

Every process notes its own times on the shared clock and reports them once a second
(:class:`~trepid.processes.journal.Timekeeper`), so that no time depends on the delay of a listener.
:class:`FrameTimes` joins the reports by frame, in the process that reads them.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np

from trepid.messages import Timing
from trepid.processes.journal import Times

HOLD_S = 5.0  # frames older than this are complete: every process reports once a second
CLASS_S = 1e-5
EXPOSED, SPREAD = "exposed_to_published", "spread"
STAGES = ("transport", "waiting", "step")
DECIDES, COMMANDS, APPLIES = "supervisor", "controller", "vehicle"
"""Names of the processes behind the estimators."""
Summary = dict[str, float]


class Histogram:
    """Durations in classes of 0.01 ms. Its size depends on how different they are, not on how many there are."""

    def __init__(self, counts: Mapping[int, int] | None = None) -> None:
        self._counts = Counter(counts)

    def add(self, duration_s: float) -> None:
        """Count a duration; one that is not finite does not count."""
        if math.isfinite(duration_s):
            self._counts[round(duration_s / CLASS_S)] += 1

    def copy(self) -> "Histogram":
        """The same durations, for further ones."""
        return Histogram(self._counts)

    def summary(self) -> Summary | None:
        """As :func:`summary` of the durations."""
        classes = np.array(sorted(self._counts.items()), float).reshape(-1, 2)
        return summary(CLASS_S * np.repeat(classes[:, 0], classes[:, 1].astype(int)))


class FrameTimes:
    """The times of all frames of a drive by process, from their reports.

    The reports on a frame are joined for ``HOLD_S`` and then counted: the memory does not grow with the drive.
    """

    def __init__(self, estimators: Iterable[str]) -> None:
        self._estimators = tuple(estimators)
        self._ends = {f"frame_to_{name}": name for name in self._estimators}
        self._ends |= {
            "frame_to_decision": DECIDES,
            "frame_to_command": COMMANDS,
            "frame_to_applied": APPLIES,
        }
        self._times: dict[str, dict[float, Times]] = {}  # of the frames that are not counted yet
        self._stages: dict[str, dict[str, Histogram]] = {}
        self._joined = {name: Histogram() for name in (EXPOSED, *self._ends, SPREAD)}
        self._newest_s = self._counted_s = -math.inf

    def add(self, report: Timing, *, from_s: float = -math.inf) -> None:
        """Add the frames of ``report`` that were captured from ``from_s`` on."""
        known = self._times.setdefault(report.process, {})
        stages = self._stages.setdefault(report.process, {name: Histogram() for name in STAGES})
        rows = zip(report.published_s, report.received_s, report.began_s, report.sent_s, strict=False)
        for frame_s, (published_s, received_s, began_s, sent_s) in zip(report.frame_s, rows, strict=False):
            if frame_s < from_s or frame_s < self._counted_s or frame_s in known:
                continue
            stamped_s = math.nan if published_s is None else published_s
            known[frame_s] = Times(stamped_s, received_s, began_s, sent_s)
            for name, ends_s, begins_s in zip(
                STAGES, (received_s, began_s, sent_s), (stamped_s, received_s, began_s), strict=True
            ):
                stages[name].add(ends_s - begins_s)
            self._newest_s = max(self._newest_s, frame_s)
        self._count(self._newest_s - HOLD_S)

    def latency_ms(self) -> dict[str, Summary | None]:
        """From the publication of a frame to the output of each process, and from its exposure to the publication.

        ``exposed_to_published`` is the share of the camera; a simulated camera renders in it. ``frame_to_command``
        ends when the command is handed to the transport, ``frame_to_applied`` when the limiter has applied it.
        """
        joined = self._of_all_frames()
        return {name: joined[name].summary() for name in (EXPOSED, *self._ends)}

    def stages_ms(self) -> dict[str, dict[str, Summary | None]]:
        """For each process: transport of the message before, waiting for the step, the step with sending."""
        return {
            process: {name: stage.summary() for name, stage in stages.items()}
            for process, stages in self._stages.items()
        }

    def spread_ms(self) -> Summary | None:
        """Time from the first to the last estimate of a frame: the wait of a decision for all estimates."""
        return self._of_all_frames()[SPREAD].summary()

    def _of_all_frames(self) -> dict[str, Histogram]:
        joined = {name: histogram.copy() for name, histogram in self._joined.items()}
        self._join(joined, before_s=math.inf)
        return joined

    def _count(self, before_s: float) -> None:
        """Count the frames captured before ``before_s`` and forget them."""
        self._join(self._joined, before_s=before_s)
        self._counted_s = max(self._counted_s, before_s)
        for times in self._times.values():
            for frame_s in [frame_s for frame_s in times if frame_s < before_s]:
                del times[frame_s]

    def _join(self, joined: Mapping[str, Histogram], *, before_s: float) -> None:
        """Add the durations of the frames captured before ``before_s`` to ``joined``."""
        estimated = [self._times.get(name, {}) for name in self._estimators]
        published = {
            frame_s: times.published_s
            for of_one in estimated
            for frame_s, times in of_one.items()
            if frame_s < before_s and math.isfinite(times.published_s)
        }
        for frame_s, published_s in published.items():
            joined[EXPOSED].add(published_s - frame_s)
            for name, process in self._ends.items():
                if found := self._times.get(process, {}).get(frame_s):
                    joined[name].add(found.sent_s - published_s)
        for frame_s in estimated[0] if estimated else ():
            if frame_s < before_s and all(frame_s in of_one for of_one in estimated):
                sent_s = [of_one[frame_s].sent_s for of_one in estimated]
                joined[SPREAD].add(max(sent_s) - min(sent_s))


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
