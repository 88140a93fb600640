"""The recording of a lock-step run, written by the code that records a live drive.

The time of a run is negative in the run-up, and stamps cannot be: the recording adds EPOCH_S to all times and notes
it as the start of the drive.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sim_harness.lockstep.closed_loop import Instant, Witness
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import Scenario
from trepid.images.jpeg import JpegEncoder
from trepid.messages import Frame
from trepid.recording.notes import Times, drive_notes
from trepid.recording.writer import Recording, attachments
from trepid.topics import (
    CAMERA_COMPRESSED,
    CAMERA_IMAGE,
    COMMAND,
    DECISION,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    ROAD_USERS,
    SIM_TRUTH,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)
from trepid.wire import to_cdr

EPOCH_S = 1000.0


@contextmanager
def recording(path: Path, scenario: Scenario, *, raw_images: bool = False) -> Iterator[Witness]:
    """A witness that records a run of ``scenario`` in ``path``. Raises InputError when it cannot be written."""
    period_s = load_simulator().period_s
    notes = drive_notes(
        what=scenario.name,
        estimators=scenario.estimators,
        cruise_speed_mps=scenario.speed_mps,
        lockstep_period_s=period_s,
        networks=scenario.networks,
    )
    with Recording(path, attachments(scenario.rules_file), notes) as file:
        file.began(EPOCH_S)
        yield _Recorder(file, Times(began_s=EPOCH_S, period_s=period_s), raw_images=raw_images).witness


class _Recorder:
    """Writes each new message once."""

    def __init__(self, file: Recording, times: Times, *, raw_images: bool) -> None:
        self._file, self._times, self._raw_images = file, times, raw_images
        self._written: dict[str, object] = {}  # the newest message of each topic
        self._encoder = JpegEncoder()
        self._photographed: Frame | None = None  # the last frame that the encoder got

    def witness(self, now: Instant) -> None:
        """Write the new messages of ``now``."""
        at_s = EPOCH_S + now.now_s
        self._write(SIM_TRUTH, now.truth, at_s)
        self._write(VEHICLE_STATE, now.state, at_s)
        if self._raw_images:
            self._write(CAMERA_IMAGE, now.frame, at_s)
        if now.frame is not None and now.frame is not self._photographed:
            self._photographed = now.frame
            self._write(CAMERA_COMPRESSED, self._encoder.step(now.frame), at_s)
        for name, estimate in now.estimates.items():
            self._write(estimate_topic(name), estimate, at_s)
        self._write(IMAGE_STATISTICS, now.statistics, at_s)
        self._write(LEAD_VEHICLE, now.lead, at_s)
        self._write(ROAD_USERS, now.road_users, at_s)
        self._write(DECISION, now.decision, at_s)
        self._write(COMMAND, now.command, at_s)

    def _write(self, topic: Topic[Any], message: Any, at_s: float) -> None:
        if message is not None and self._written.get(topic.key) is not message:
            self._written[topic.key] = message
            self._file.add(topic.key, to_cdr(self._times.in_recorded_time(message)), at_s=at_s)
