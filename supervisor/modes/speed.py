"""How fast fear lets the car drive: less at once, more only slowly."""

from supervisor.rules.inference import FearRules
from trepid.bounds import at_least, at_most
from trepid.clothoid import Motion


class SpeedFactor:
    """The share of the cruise speed: falls with fear at once, rises slowly, but fast to the speed still driven."""

    def __init__(self, rules: FearRules, cruise_speed_mps: float) -> None:
        self._rules, self._cruise_speed_mps = rules, cruise_speed_mps
        self._factor = 0.0
        self._last_s: float | None = None

    def adopt(self, rules: FearRules) -> None:
        """Go on with the actions of ``rules``, at the speed of now."""
        self._rules = rules

    def step(
        self, fear: float, motion: Motion | None, *, stopping: bool, begins: bool, now_s: float
    ) -> float:
        """The factor at ``now_s``; 0 while ``stopping``.

        Where a drive ``begins`` it begins at the speed that the car has: that of the driver, or standstill.
        """
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        if stopping:
            self._factor = 0.0
            return 0.0
        hysteresis = self._rules.file.hysteresis
        driven = 0.0 if motion is None else motion.speed_mps / self._cruise_speed_mps
        caught_up = driven if begins else at_most(self._factor + hysteresis.catch_up_per_s * dt_s, driven)
        risen = at_least(self._factor + hysteresis.recovery_per_s * dt_s, caught_up)
        self._factor = at_most(risen, self._rules.speed_factor(fear))
        return self._factor
