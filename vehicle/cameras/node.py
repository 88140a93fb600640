"""Camera process: the frames of the configured source, upright and of the working size, on the bus."""

import os
import statistics
import time

import cv2
import numpy as np

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.jpeg import JpegEncoder, RateFilter
from trepid.messages import Frame, Health
from trepid.processes.process import Process, process
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE
from trepid.types import Image
from vehicle.cameras.source import CameraSource, SourceContext, Values
from vehicle.cameras.table import build, configured_source
from vehicle.cameras.working import Unfit, Working, WorkingSettings

WHITE, BLACK = 250, 5  # grey levels of over- and under-exposed pixels
GAP = 1.5  # periods between two frames of which one is missing
STEP_PX = 4  # of the pixels that count for the exposure


class FrameStatistics:
    """Statistics of the frames since the last call of :meth:`values`."""

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._gaps_s: list[float] = []
        self._period_s: float | None = None  # the usual one, over the frames before
        self._missing = 0  # since the start
        self._refused = 0

    def add(self, frame: Frame) -> None:
        """Count a frame."""
        if self._last is not None:
            self._gaps_s.append(frame.t_s - self._last.t_s)
        self._last = frame

    def refuse(self) -> None:
        """Count a frame that was refused."""
        self._refused += 1

    def values(self) -> Values:
        """Gaps since the last call [ms], missing frames since the start, exposure of the newest frame.

        A gap of n usual periods counts as n − 1 missing frames.
        """
        gaps_s, self._gaps_s = self._gaps_s, []
        values = []
        if gaps_s:
            usual_s = self._period_s or statistics.median(gaps_s)
            self._missing += sum(round(gap_s / usual_s) - 1 for gap_s in gaps_s if gap_s > GAP * usual_s)
            self._period_s = statistics.median(gaps_s)
            values += [
                ("gap_median_ms", f"{1e3 * self._period_s:.1f}"),
                ("gap_max_ms", f"{1e3 * max(gaps_s):.1f}"),
            ]
        values += [("missing_frames", str(self._missing)), ("refused_frames", str(self._refused))]
        return (*values, *(exposure(self._last.image) if self._last is not None else ()))


def exposure(image: Image) -> Values:
    """Mean grey level, and shares of pixels at white and at black, each 0 to 1."""
    part = np.ascontiguousarray(image[::STEP_PX, ::STEP_PX])
    grey = np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY))
    return (
        ("brightness", f"{grey.mean() / 255:.3f}"),
        ("over_exposed", f"{np.mean(grey >= WHITE):.3f}"),
        ("under_exposed", f"{np.mean(grey <= BLACK):.3f}"),
    )


RETRY_S = 0.5  # between two attempts to open a camera that is absent after a restart


class CameraStep:
    """The step between a source and the bus."""

    def __init__(self, settings: WorkingSettings, camera: Camera) -> None:
        self.working = Working(settings, camera)
        self.statistics = FrameStatistics()
        self._rate = RateFilter(settings.rate_hz)
        self.encoder = JpegEncoder(
            rate_hz=settings.compressed_hz, budget_kb_per_s=settings.compressed_kb_per_s
        )
        self._silence_s = settings.silence_s
        self._good_s: float | None = None  # when the last frame was published
        self._refusal = ""

    def step(self, frame: Frame | None) -> Frame | None:
        """The working frame; None for a frame that is refused or not due.

        Raises InputError when the first frame does not fit the camera.
        """
        if frame is None or not self._rate.passes(frame.t_s):
            return None
        try:
            working = self.working.step(frame)
        except Unfit as error:
            self._refusal = str(error)
            self.statistics.refuse()
            return None
        self._refusal = ""
        self.statistics.add(working)
        return working

    def health(self, sent: bool, trouble: str, *, now_s: float) -> tuple[Health, str]:
        """WARN and the reason while frames are refused or absent; ``trouble``: the fault of the source."""
        if self._good_s is None or sent:
            self._good_s = now_s
        if self._refusal:
            return Health.WARN, self._refusal
        if now_s - self._good_s < self._silence_s:
            return Health.OK, ""
        return Health.WARN, f"no frame: {trouble}" if trouble else "no frame"

    def values(self) -> Values:
        """Values for the heartbeat."""
        size = self.working.source_size
        return (*((("source_px", "{}x{}".format(*size)),) if size else ()), *self.statistics.values())


def run(me: Process) -> None:
    """Read, correct and publish until the process is to stop."""
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    opened = opened_source(me)
    if opened is None:
        return
    name, source, settings = opened
    try:
        drive(me, name, source, CameraStep(settings, camera))
    finally:
        source.close()


def opened_source(me: Process) -> tuple[str, CameraSource, WorkingSettings] | None:
    """The configured source. Raises InputError when it cannot be opened.

    A process that was started again during a drive waits for its camera instead, as for one that is unplugged; None
    when the drive ends before the camera is there.
    """
    configured_source()  # a fault in the settings is refused in each case
    while True:
        try:
            return build(SourceContext(me.bus, me.now_s))
        except InputError as error:
            if not me.restarts:
                raise
            me.alive(Health.WARN, f"no frame: {error}")
        me.bus.wait(timeout_s=RETRY_S)
        if not me.running():
            return None


def drive(me: Process, name: str, source: CameraSource, node: CameraStep) -> None:
    """The loop of :func:`run`."""
    send, send_compressed = me.bus.publisher(CAMERA_IMAGE), me.bus.publisher(CAMERA_COMPRESSED)
    me.ready(values=lambda: (("source", name), *source.values(), *node.values()))
    while me.running():
        frame = source.read(timeout_s=0.1)
        working = node.step(frame)
        if working is not None:
            send(working)
            jpeg = node.encoder.step(working)
            if jpeg is not None:
                send_compressed(jpeg)
        health, message = node.health(working is not None, source.trouble, now_s=me.now_s())
        (me.alive if working is None else me.count_step)(health, message)
        if frame is None and source.ended:
            time.sleep(0.05)


def quiet_libraries() -> None:
    """Keep OpenCV and FFmpeg from writing to the log: errors are reported by this process in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    quiet_libraries()
    with process() as me:
        run(me)
