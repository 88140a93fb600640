"""The recording of a lock-step run, written by the code that records a live drive.

The time of a run is negative in the run-up, and stamps cannot be: the recording adds EPOCH_S to all times and notes
it as the start of the drive.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from sim_harness.lockstep.camera import compressed
from sim_harness.lockstep.closed_loop import Instant, Witness
from sim_harness.scenarios.scenario import Scenario
from trepid.recording.writer import Recording
from trepid.topics import (
    CAMERA_COMPRESSED,
    COMMAND,
    DECISION,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    SIM_TRUTH,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)
from trepid.wire import to_cdr

EPOCH_S = 1000.0
_TIMES = ("t_s", "decided_s", "path_t_s")  # of any message


@contextmanager
def recording(path: Path, scenario: Scenario) -> Iterator[Witness]:
    """A witness that records a run of ``scenario`` in ``path``. Raises InputError when it cannot be written."""
    with Recording(path, [scenario.rules_file]) as file:
        file.began(EPOCH_S)
        yield _Recorder(file).witness


class _Recorder:
    """Writes each new message once."""

    def __init__(self, file: Recording) -> None:
        self._file = file
        self._written: dict[str, object] = {}  # the newest message of each topic
        self._photographed_s = -EPOCH_S

    def witness(self, now: Instant) -> None:
        """Write the new messages of ``now``."""
        at_s = EPOCH_S + now.now_s
        self._write(SIM_TRUTH, now.truth, at_s)
        self._write(VEHICLE_STATE, now.state, at_s)
        if (
            now.frame is not None
            and now.now_s - self._photographed_s >= 1.0 / CAMERA_COMPRESSED.rate_hz - 1e-9
        ):
            self._photographed_s = now.now_s
            self._write(CAMERA_COMPRESSED, compressed(now.frame), at_s)
        for name, estimate in now.estimates.items():
            self._write(estimate_topic(name), estimate, at_s)
        self._write(IMAGE_STATISTICS, now.statistics, at_s)
        self._write(LEAD_VEHICLE, now.lead, at_s)
        self._write(DECISION, now.decision, at_s)
        self._write(COMMAND, now.command, at_s)

    def _write(self, topic: Topic[Any], message: Any, at_s: float) -> None:
        if message is not None and self._written.get(topic.key) is not message:
            self._written[topic.key] = message
            self._file.add(topic.key, to_cdr(_stamped(message)), at_s=at_s)


def _stamped(message: Any) -> Any:
    """``message`` with its times counted from EPOCH_S."""
    times_s = {name: getattr(message, name, None) for name in _TIMES}
    return replace(message, **{name: EPOCH_S + t_s for name, t_s in times_s.items() if t_s is not None})
