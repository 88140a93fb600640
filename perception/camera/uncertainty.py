"""What is known about the height of a camera without a camera file."""

import math
from dataclasses import dataclass

QUARTERS = (-1.150, -0.319, 0.319, 1.150)  # medians of the quarters of a normal distribution
MAX_SURPRISE = 2.0  # standard deviations; a width further from the belief is no lane of this road


@dataclass(frozen=True, slots=True)
class HeightBelief:
    """A log-normal belief: ``median_m``, and the standard deviation ``sigma`` of the logarithm of the height."""

    median_m: float
    sigma: float

    @property
    def hypotheses_m(self) -> tuple[float, ...]:
        """Four equally likely heights: the median of each quarter of the distribution."""
        return tuple(self.median_m * math.exp(self.sigma * z) for z in QUARTERS)

    def given_width(self, width_heights: float, *, width_m: float, width_sigma_m: float) -> "HeightBelief":
        """The belief after a lane between two lines, ``width_heights`` heights of the camera wide.

        Lanes are W ± σ_W wide, so log h = log(W/width_heights) ± σ_W/W: the product of two normal densities. A
        width further than ``MAX_SURPRISE`` from the belief is that of a road or of half a lane: no change.
        """
        own, other = self.sigma**2, (width_sigma_m / width_m) ** 2
        apart = math.log(width_m / width_heights) - math.log(self.median_m)
        if apart**2 > MAX_SURPRISE**2 * (own + other):
            return self
        gain = own / (own + other)
        return HeightBelief(self.median_m * math.exp(gain * apart), math.sqrt((1 - gain) * own))
