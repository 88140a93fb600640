"""The share of the cruise speed at a level of fear: it falls at once and rises slowly."""

from supervisor.rules.inference import FearRules
from trepid.bounds import at_least, at_most
from trepid.clothoid import Motion


class SpeedFactor:
    """The share of the cruise speed: falls with fear at once, rises slowly, but fast up to the present speed."""

    def __init__(self, cruise_speed_mps: float) -> None:
        self._cruise_speed_mps = cruise_speed_mps
        self._factor = 0.0
        self._last_s: float | None = None

    def step(
        self,
        rules: FearRules,
        fear: float,
        motion: Motion | None,
        *,
        stopping: bool,
        begins: bool,
        now_s: float,
    ) -> float:
        """The factor at ``now_s``; 0 while ``stopping``.

        A drive that ``begins`` starts with the present speed of the car: that of the driver, or standstill.
        """
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        if stopping:
            self._factor = 0.0
            return 0.0
        hysteresis = rules.file.hysteresis
        driven = 0.0 if motion is None else motion.speed_mps / self._cruise_speed_mps
        caught_up = driven if begins else at_most(self._factor + hysteresis.catch_up_per_s * dt_s, driven)
        risen = at_least(self._factor + hysteresis.recovery_per_s * dt_s, caught_up)
        self._factor = at_most(risen, rules.speed_factor(fear))
        return self._factor
