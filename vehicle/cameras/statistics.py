"""Exposure of the frames and gaps between them, for the heartbeat."""

import statistics

import cv2
import numpy as np

from trepid.messages import Frame
from trepid.types import Image
from vehicle.cameras.source import Values

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
