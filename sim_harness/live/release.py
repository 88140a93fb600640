"""The release of a simulated world by the launcher of a live drive."""

from trepid.bus import Bus
from trepid.topics import LOSSES


class Release:
    """Whether the simulated world may move: every process that matters to the drive has reported.

    The time before the first motion of the car is then no part of a drive, and no metre of it is left unjudged.
    """

    def __init__(self, bus: Bus) -> None:
        self._report = bus.latest(LOSSES, wakes=False)
        self._granted = False

    def is_granted(self) -> bool:
        """True from the first report of the launcher on that awaits no process; False without any report."""
        report = self._report.take()
        self._granted = self._granted or (report is not None and not report.awaited)
        return self._granted
