"""A recording on the bus, at any rate: for `trepid status`, the page, and processes of others.

The clock of the bus begins at the first recorded time, so that at the rate 1 the messages have the ages that they
had in the drive. The bytes are published as they were recorded.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path

from trepid.bus import open_bus
from trepid.clock import NANO, epoch_clock
from trepid.config import InputError
from trepid.processes.endpoint import usable_endpoint
from trepid.processes.register import Running, register_drive, ticks
from trepid.recording.foreign import in_order
from trepid.security import LAUNCHER, session_settings

LISTENERS_S = 0.5  # for subscribers to connect before the first message
BEHIND_S = 0.2  # later than this, a message is published at once


def play(
    path: Path, *, rate: float, vehicle_name: str, say: Callable[[str], None], running: Callable[[], bool]
) -> int:
    """Publish every message of ``path`` in its order, ``rate`` times as fast as it was recorded, while ``running``.

    Returns the number of messages. Raises InputError when ``path`` holds none, and for an endpoint that
    cannot be used.
    """
    coming = in_order(path)
    first = next(coming, None)
    if first is None:
        raise InputError(f"{path}: holds no message to play")
    first_ns = first[0]
    offset_ns = first_ns - time.monotonic_ns() - round(LISTENERS_S * NANO)
    endpoint = usable_endpoint()
    secured = session_settings(LAUNCHER, publishes=None, listen=endpoint)
    entry = Running(
        pid=os.getpid(),
        started_ticks=ticks(os.getpid()) or 0,
        vehicle_name=vehicle_name,
        endpoint=endpoint,
        clock_offset_ns=offset_ns,
        car=None,
        what=f"replay of {path.name}",
    )
    senders: dict[str, Callable[[bytes], None]] = {}
    count = 0
    with (
        open_bus(vehicle_name, epoch_clock(offset_ns), listen=endpoint, further=secured) as bus,
        register_drive(entry),
    ):
        say(f"{path}: plays at {endpoint}, vehicle {vehicle_name}; `trepid status` shows its processes")
        began_s = time.monotonic() + LISTENERS_S
        while first is not None and running():
            at_ns, key, data = first
            wait_s = began_s + (at_ns - first_ns) / NANO / rate - time.monotonic()
            if wait_s > 0.0:
                time.sleep(min(wait_s, BEHIND_S))
                if wait_s > BEHIND_S:
                    continue  # look again whether it is to go on
            if key not in senders:
                senders[key] = bus.forwarder(key)
            senders[key](data)
            count += 1
            first = next(coming, None)
    return count
