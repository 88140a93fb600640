"""Mean doubt about the edges of a road without lines over the last metres of way.

The edges of an unmarked road are measured all along. Trodden snow has edges of its own in patches, between which
the edges of the road come and go: single frames look valid, the mean over the way does not.
"""

from supervisor.inputs.running_mean import RunningMean
from supervisor.inputs.validated import ValidatedEstimate, surest_of_marking
from trepid.bounds import at_least
from trepid.clothoid import STANDING, Motion

EDGES_M = 20.0  # patches are some metres long; a comfort stop from 8 m/s takes 16 m


class WeakEdges:
    """Holds the mean, which changes with distance only: the image of a standing car does not change."""

    def __init__(self) -> None:
        self._doubt = RunningMean(0.0)
        self._last_s: float | None = None

    def step(self, seen: list[ValidatedEstimate], motion: Motion | None, *, now_s: float) -> float:
        """Mean of 1 - confidence of edges, of 0 for lines, over the last EDGES_M, the nearer the heavier [0..1].

        Without an estimator that distinguishes edges from lines it stays as it is.
        """
        way_m = 0.0 if self._last_s is None else abs((motion or STANDING).speed_mps) * (now_s - self._last_s)
        self._last_s = now_s
        estimate = surest_of_marking(seen)
        if estimate is not None:
            doubt = 0.0 if estimate.marked else 1.0 - (estimate.confidence or 0.0)
            self._doubt = self._doubt.moved(doubt, at_least(way_m, 0.0), length=EDGES_M)
        return self._doubt.mean
