"""The release of a simulated world by the launcher of a live drive."""

from trepid.processes.process import Process
from trepid.topics import LOSSES


class Release:
    """Whether the simulated world may move: every process that matters to the drive has reported.

    The time before the first motion of the car is then no part of a drive, and no metre of it is left unjudged. A
    world that no launcher started, such as the other end of the wire of a real car, waits for none.
    """

    def __init__(self, me: Process) -> None:
        self._report = me.bus.latest(LOSSES, wakes=False)
        self._granted = not me.options.get("awaits_release", False)

    def is_granted(self) -> bool:
        """True from the first report of the launcher on that awaits no process."""
        report = self._report.take()
        self._granted = self._granted or (report is not None and not report.awaited)
        return self._granted
