"""A running mean with weights that decay exponentially with distance or time."""

import math
from typing import NamedTuple


class RunningMean(NamedTuple):
    """Weighted sum of values and the sum of their weights; a new value decays the former ones."""

    total: float
    weight: float = 1.0

    @property
    def mean(self) -> float:
        """The weighted mean."""
        return self.total / self.weight

    def after(self, value: float, step: float, *, length: float) -> "RunningMean":
        """The mean with ``value`` over ``step``; former values keep exp(-step/length) of their weight.

        ``step`` and ``length`` have one unit, of way or of time.
        """
        kept = math.exp(-step / length)
        return RunningMean(kept * self.total + (1 - kept) * value, kept * self.weight + (1 - kept))

    def moved(self, value: float, step: float, *, length: float) -> "RunningMean":
        """:meth:`after` for a mean of weight 1, in the form mean + share·(value - mean), which rounds otherwise."""
        share = 1.0 - math.exp(-step / length)
        return RunningMean(self.total + share * (value - self.total))
