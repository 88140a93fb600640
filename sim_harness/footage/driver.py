"""The driver beside a car on footage: hands over when the car says that it is ready, takes over when it stops."""

from supervisor.modes.waits import READY
from trepid.messages import Decision, Mode


class SafetyDriver:
    """Drives at first, and whenever the car does not.

    On the move, the supervisor leaves only the stop in which it starts. After any other stop the loop therefore
    starts a new drive.
    """

    def __init__(self, run_up_s: float) -> None:
        """``run_up_s``: the least time before the first hand-over."""
        self._run_up_s, self._since_s = run_up_s, 0.0
        self.drives = True

    def step(self, decision: Decision | None, *, now_s: float) -> bool:
        """Whether the driver drives from ``now_s`` on. A decision from before a change says nothing about it."""
        if decision is not None and decision.decided_s >= self._since_s:
            if self.drives:
                changes = now_s >= self._run_up_s and decision.waits_for == READY
            else:
                changes = decision.mode is Mode.STOP
            if changes:
                self.drives, self._since_s = not self.drives, now_s
        return self.drives
