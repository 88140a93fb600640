"""Whether a measurement moves with what should move it, where both are small: a regression over several seconds.

On a straight road the wheels move by a few milliradians, within the tolerance of any single comparison. A wrong
sign or the value of another sensor shows in the slope b of the measurement y over the expected value x. Both pass
the same low pass of two first-order stages of time constant τ, above which the unknown lag of a car may turn their
phase, and lose their mean, so that an offset has no effect. With means over a forgetting window of T seconds,

    b = ⟨xy⟩/⟨x²⟩,    σ_b² = (⟨y²⟩ - b·⟨xy⟩)/(⟨x²⟩·(n - 2)),    n = min(elapsed, 2T)/(4τ),

n is the number of independent values: 4τ is the integral of the autocorrelation of low-passed white noise,
(1 + |t|/τ)·exp(-|t|/τ), and 2T the length of the rectangular window that averages as much (Bendat and Piersol,
Random Data, section 8). A witness w, the same quantity by another sensor, tells which of the two is wrong.
"""

import math
from typing import NamedTuple

from vehicle.measurement.settings import SlopeSettings

STAGES = 2  # of the low pass
LEAST_VALUES = 6.0  # independent ones; fewer give no deviation


class Triple(NamedTuple):
    """The quantity as expected, as measured, and as another sensor gives it."""

    expected: float
    measured: float
    witness: float


class Slope:
    """Call ``step`` with every pair of the moving car."""

    def __init__(self, settings: SlopeSettings, *, filter_s: float) -> None:
        """``filter_s``: τ."""
        self._settings, self._filter_s = settings, filter_s
        self.clear()

    def clear(self) -> None:
        """Forget all values."""
        self._stages: list[Triple] = []
        self._means = Triple(0.0, 0.0, 0.0)
        self._xx = self._xy = self._yy = 0.0
        self._off_expected = self._off_measured = 0.0
        self._elapsed_s = 0.0

    def step(self, expected: float, measured: float, witness: float, dt_s: float) -> None:
        """Add one value of each, ``dt_s`` after the last ones."""
        now = Triple(expected, measured, witness)
        if not self._stages:
            self._stages, self._means = [now] * STAGES, now
        share = dt_s / (self._filter_s + dt_s)
        for number, stage in enumerate(self._stages):
            now = self._stages[number] = _move_towards(stage, now, share)
        self._elapsed_s += dt_s
        if not self._elapsed_s:
            return
        share = dt_s / min(self._elapsed_s, self._settings.span_s)
        self._means = _move_towards(self._means, now, share)
        x, y, w = (value - mean for value, mean in zip(now, self._means, strict=True))
        self._xx += share * (x * x - self._xx)
        self._xy += share * (x * y - self._xy)
        self._yy += share * (y * y - self._yy)
        self._off_expected += share * ((w - x) ** 2 - self._off_expected)
        self._off_measured += share * ((w - y) ** 2 - self._off_measured)

    @property
    def interval(self) -> tuple[float, float] | None:
        """b ± ``sigmas``·σ_b; None while too little moves, the values are too few, or the witness does not agree.

        The witness agrees with x where it is at least twice as near to it as to y, in mean square.
        """
        limits = self._settings
        values = min(self._elapsed_s, 2.0 * limits.span_s) / (2.0 * STAGES * self._filter_s)
        witnessed = 2.0 * self._off_expected < self._off_measured
        if math.sqrt(self._xx) < limits.moved_rad or values < LEAST_VALUES or not witnessed:
            return None
        slope = self._xy / self._xx
        left = max(self._yy - slope * self._xy, 0.0)
        half = limits.sigmas * math.sqrt(left / (self._xx * (values - 2.0)))
        return slope - half, slope + half


def _move_towards(old: Triple, new: Triple, share: float) -> Triple:
    return Triple(*(before + share * (value - before) for before, value in zip(old, new, strict=True)))
