"""The time of capture of frames of a live device."""

import math

MAX_AGE_S = 1.0  # of the first frames; a larger one means that the device counts on another clock


class CaptureStamps:
    """Times of capture by the stamps of the kernel where these are plausible, else by the return of the grab.

    V4L2 stamps a buffer on CLOCK_MONOTONIC (linux/videodev2.h, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC); OpenCV returns
    the stamp as CAP_PROP_POS_MSEC. With the age a = grabbed − stamped the frame was captured at t = now − a. A
    stamp is plausible if it is later than the one before it and 0 ≤ a < 1 s. After a plausible one, a may be
    larger: then the buffer waited while the process stood still, and its image is old indeed.
    """

    def __init__(self) -> None:
        self._kernel_s = -math.inf
        self._last_s = -math.inf
        self._trusted = False
        self.origin = "none yet"
        """Where the newest time comes from: "kernel" or "grab"."""

    def stamp(self, kernel_s: float, *, grabbed_s: float, now_s: float) -> float | None:
        """The time of capture [s] on the clock of ``now_s``; None when it does not follow the one before it.

        ``kernel_s``: stamp of the device, ``grabbed_s``: return of the grab, both on CLOCK_MONOTONIC.
        """
        age_s = grabbed_s - kernel_s
        limit_s = math.inf if self._trusted else MAX_AGE_S
        plausible = kernel_s > max(self._kernel_s, 0.0) and 0 <= age_s < limit_s
        self._trusted = self._trusted or plausible
        self.origin = "kernel" if plausible else "grab"
        if plausible:
            self._kernel_s = kernel_s
        t_s = now_s - age_s if plausible else now_s
        if t_s <= self._last_s:
            return None
        self._last_s = t_s
        return t_s
