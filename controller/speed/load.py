"""Observer of the load: acceleration of the car that its drive and brakes do not explain, such as a hill.

    v' = a + d        a' = (demand - a)/τ_a        d' = 0

d = -g·sin θ - rolling and air drag [m/s²], estimated by an observer with both poles at ``BANDWIDTH_RADPS``:

    v̂' = a + d̂ + 2ω·(v - v̂)        d̂' = ω²·(v - v̂)

Added to the demand it acts as an integral, but without wind-up while the demand is bounded and without response
to a new target. An error beyond ``TORN_MPS``, as from a driver's brake, resets the model.

Luenberger, An introduction to observers, IEEE TAC 16(6), 1971; Rajamani, Vehicle Dynamics and Control (2012),
section 4.1 (longitudinal forces).
"""

from controller.model.lag import left_after
from trepid.bounds import within

BANDWIDTH_RADPS = 1.0
TORN_MPS = 0.5  # a sudden hill of 20 % gives 0.25 m/s


class LoadObserver:
    """Call ``step`` with the demand that has acted since the last step."""

    def __init__(self, drive_lag_s: float, *, limit_mps2: float) -> None:
        self.load_mps2 = 0.0  # d̂
        self.acting_mps2 = 0.0  # a
        self._lag_s, self._limit_mps2 = drive_lag_s, limit_mps2
        self._speed_mps: float | None = None  # v̂; None: to be read first

    def step(self, demand_mps2: float, *, speed_mps: float, dt_s: float) -> None:
        """Update with the speed after ``dt_s`` of ``demand_mps2``."""
        before_mps2 = self.acting_mps2
        keep = left_after(dt_s, self._lag_s)
        self.acting_mps2 = demand_mps2 + (before_mps2 - demand_mps2) * keep
        gained_mps = demand_mps2 * dt_s + (before_mps2 - demand_mps2) * self._lag_s * (1.0 - keep)
        if self._speed_mps is None:
            self._speed_mps = speed_mps
            return
        self._speed_mps += gained_mps + self.load_mps2 * dt_s
        error = speed_mps - self._speed_mps
        if abs(error) > TORN_MPS:
            self._speed_mps = speed_mps
            return
        self._speed_mps += 2.0 * BANDWIDTH_RADPS * dt_s * error
        self.load_mps2 = within(self.load_mps2 + BANDWIDTH_RADPS**2 * dt_s * error, self._limit_mps2)

    def standing(self) -> None:
        """The car stands: the brake holds, and the load stays as estimated."""
        self.acting_mps2, self._speed_mps = 0.0, None

    def pause(self) -> None:
        """The acting demand is not known."""
        self._speed_mps = None
