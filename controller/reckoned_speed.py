"""The speed to steer with while the measured one is doubted: the last one, less the brake demanded since."""

from trepid.bounds import at_least, at_most


class ReckonedSpeed:
    """v' = min(a, 0) from the last measurement on, a the demand behind the lag of the drive; never below 0."""

    def __init__(self, drive_lag_s: float) -> None:
        self._lag_s = drive_lag_s
        self._accel_mps2 = 0.0
        self._speed_mps: float | None = None  # None before the first measurement
        self.demand_mps2 = 0.0
        """The last demand of acceleration, to be set after every step."""

    def step(self, measured_mps: float | None, dt_s: float) -> float | None:
        """The measured speed, or what is left of the last one ``dt_s`` after the last step; None without any."""
        if dt_s > 0.0:
            self._accel_mps2 += dt_s / (self._lag_s + dt_s) * (self.demand_mps2 - self._accel_mps2)
        if measured_mps is not None:
            self._speed_mps = measured_mps
        elif self._speed_mps is not None:
            self._speed_mps = at_least(self._speed_mps + at_most(self._accel_mps2, 0.0) * dt_s, 0.0)
        return self._speed_mps
