"""From acceleration to speed: an RC car takes no acceleration, its speed controller takes a speed.

The demand is the integral v_d += a·dt, from 0 up to the fastest speed of the throttle table. With a sensor it is at
most ``LEAD_MPS`` above the measured speed, so that it does not wind up on a hill or with a flat battery; after
neutral an acceleration starts it at most ``LEAD_MPS`` below. Nothing else raises it: a car that is faster than its
table would be driven faster by a demand that follows its speed. The modelled speed follows the demand with a lag of
first order: v += (v_d - v)·(1 - exp(-dt/T)).
"""

import math

LEAD_MPS = 0.5
LONGEST_S = 0.05  # a pause of this process counts as this long
CREEP_MPS = 0.02  # a slower demand of a braking car is standstill


class SpeedIntegrator:
    """Call ``step`` with every command."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._then_s: float | None = None
        self.demand_mps = 0.0
        """The speed for the throttle table."""
        self.modelled_mps = 0.0
        """The speed that the car should have; it stands until the first command."""

    def step(self, accel_mps2: float, most_mps: float, measured_mps: float | None, *, now_s: float) -> float:
        """The speed demand at ``now_s`` [m/s]; ``measured_mps`` is None without a sensor."""
        dt_s = 0.0 if self._then_s is None else max(0.0, min(now_s - self._then_s, LONGEST_S))
        self._then_s = now_s
        part = 1.0 if self._lag_s <= 0.0 else 1.0 - math.exp(-dt_s / self._lag_s)
        self.modelled_mps += part * (self.demand_mps - self.modelled_mps)
        demand_mps = self.demand_mps
        if measured_mps is not None and demand_mps == 0.0 and accel_mps2 > 0.0:
            demand_mps = max(0.0, measured_mps - LEAD_MPS)
        demand_mps += accel_mps2 * dt_s
        if measured_mps is not None:
            demand_mps = min(measured_mps + LEAD_MPS, demand_mps)
        if accel_mps2 <= 0.0 and demand_mps < CREEP_MPS:
            demand_mps = 0.0
        self.demand_mps = max(0.0, min(most_mps, demand_mps))
        if self.demand_mps == 0.0 and self.modelled_mps < CREEP_MPS:
            self.modelled_mps = 0.0
        return self.demand_mps

    def rest(self, for_s: float, *, now_s: float) -> None:
        """The throttle has been neutral for ``for_s`` up to ``now_s``, without a command."""
        self._then_s = now_s
        self.demand_mps = 0.0
        self.modelled_mps *= math.exp(-for_s / self._lag_s) if self._lag_s > 0.0 else 0.0
