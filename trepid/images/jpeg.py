"""Frames as JPEG, for recordings and the page, at a highest rate and within a budget of bytes."""

import math

import cv2

from trepid.messages import CompressedFrame, Frame

BEST, LEAST = 80, 20  # quality
BUDGET_KB_PER_S = 400.0  # 24 MB a minute; frames of 320 x 240 px take about 11 kB at the best quality
DOWN, UP = 6, 1  # steps of the quality after a frame that is too large, and after one that is small
ROOM = 0.85  # of its share of the budget: a smaller frame lets the quality rise
SAVED_S = 1.0  # of the budget that is not used is kept
EARLY = 0.2  # share of a period by which a frame may come before it is due


class JpegEncoder:
    """Encodes frames. Where they exceed the budget, the quality falls; at the least one frames are left out.

    Each frame has the share of the budget of the time since the one before. A frame is left out while those before
    it have taken more than the budget, so that over any longer time it is kept.
    """

    def __init__(self, *, rate_hz: float | None = None, budget_kb_per_s: float = BUDGET_KB_PER_S) -> None:
        """``rate_hz``: the highest rate; None: every frame."""
        self._thinned = RateFilter(rate_hz)
        self._bytes_per_s = 1e3 * budget_kb_per_s
        self._left = SAVED_S * self._bytes_per_s  # of the budget [B]
        self._last_s = -math.inf
        self.quality = BEST

    def step(self, frame: Frame) -> CompressedFrame | None:
        """``frame`` as JPEG; None where it is not due or beyond the budget."""
        if not self._thinned.passes(frame.t_s):
            return None
        since_s = min(max(frame.t_s - self._last_s, 0.0), SAVED_S)
        self._last_s = frame.t_s
        share = since_s * self._bytes_per_s
        self._left = min(self._left + share, SAVED_S * self._bytes_per_s)
        if self._left < 0.0:
            return None
        jpeg = encode_jpeg(frame, self.quality)
        self._left -= len(jpeg.jpeg)
        change = -DOWN if len(jpeg.jpeg) > share else UP if len(jpeg.jpeg) < ROOM * share else 0
        self.quality = min(max(self.quality + change, LEAST), BEST)
        return jpeg


class RateFilter:
    """Which frames pass at a given highest rate."""

    def __init__(self, rate_hz: float | None) -> None:
        self._period_s = 1 / rate_hz if rate_hz else 0.0
        self._due_s = -math.inf

    def passes(self, t_s: float) -> bool:
        """True for a frame captured at ``t_s`` that is due."""
        if t_s < self._due_s - EARLY * self._period_s:
            return False
        on_schedule = t_s - self._due_s < self._period_s
        self._due_s = (self._due_s if on_schedule else t_s) + self._period_s
        return True


def encode_jpeg(frame: Frame, quality: int = BEST) -> CompressedFrame:
    """``frame`` as JPEG."""
    _, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return CompressedFrame(t_s=frame.t_s, jpeg=jpeg.tobytes())
