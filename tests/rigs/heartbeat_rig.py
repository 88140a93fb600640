"""A bus for the heartbeats of one process."""

from typing import Any

from trepid.messages import Diagnostic


class RecordingBus:
    """A bus that records published messages and reports the given counts of malformed messages."""

    def __init__(self) -> None:
        self.sent: list[Diagnostic] = []
        self.counts: dict[str, int] = {}

    def publisher(self, _topic: Any) -> Any:
        """What records a message."""
        return self.sent.append

    def malformed_counts(self) -> dict[str, int]:
        """Counts by topic."""
        return dict(self.counts)
