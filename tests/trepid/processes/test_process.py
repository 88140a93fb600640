"""The heartbeat of a process."""

import threading

from trepid.processes.process import Assignment, Process


class Outbox:
    """A bus that keeps what is published."""

    def __init__(self):
        self.sent = []

    def publisher(self, _topic):
        return self.sent.append


def test_a_heartbeat_carries_the_process_own_values_as_they_are_then():
    bus, seen = Outbox(), [0]
    me = Process(
        Assignment(name="one", vehicle_name="v", connect="", clock_offset_ns=0), bus, threading.Event()
    )
    me.ready(values=lambda: (("seen", str(seen[0])),))
    seen[0] = 3
    me.beat(bus.sent[0].health, "later")
    assert [dict(beat.values)["seen"] for beat in bus.sent] == ["0", "3"]
    assert {"pid", "rate_hz", "cpu_percent"} <= dict(bus.sent[0].values).keys()
