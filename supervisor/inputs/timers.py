"""For how long something has been so: the clocks behind the supervisor's hysteresis. None reads a clock itself."""

from collections.abc import Mapping

from trepid.bounds import at_least, at_most


class Stopwatch:
    """For how long a condition has held without a break."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def step(self, condition: bool, *, now_s: float) -> float:
        """Seconds since ``condition`` began to hold; 0 while it does not."""
        if not condition:
            self._since_s = None
            return 0.0
        if self._since_s is None:
            self._since_s = now_s
        return at_least(now_s - self._since_s, 0.0)


class Held:
    """Watches for how long a condition holds without a break."""

    def __init__(self) -> None:
        self._watch = Stopwatch()

    def lasts(self, condition: bool, wanted_s: float | None, *, now_s: float) -> bool:
        """Whether ``condition`` has now held for ``wanted_s``; None is never reached."""
        held_s = self._watch.step(condition, now_s=now_s)
        return condition and wanted_s is not None and held_s >= wanted_s


class Patience:
    """For how long one cause has frightened: grows while it does, shrinks as fast while it does not.

    So a cause that comes and goes from frame to frame is neither forgotten nor made worse than it is. While another
    of the causes that are waited for frightens, it stays as it is: they are doubts about the same road.
    """

    def __init__(self, stop_after_s: Mapping[str, float]) -> None:
        self._stop_after_s = stop_after_s
        self._borne_s = dict.fromkeys(stop_after_s, 0.0)
        self._last_s: float | None = None

    def ends(self, cause: str, *, now_s: float) -> bool:
        """Whether ``cause``, "" for none, has lasted longer than it may."""
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        for name, limit_s in self._stop_after_s.items():
            step_s = dt_s if name == cause else 0.0 if cause in self._stop_after_s else -dt_s
            self._borne_s[name] = at_most(at_least(self._borne_s[name] + step_s, 0.0), limit_s)
        return cause in self._borne_s and self._borne_s[cause] >= self._stop_after_s[cause]
