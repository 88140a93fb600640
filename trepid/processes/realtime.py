"""The real-time class of a process: its option ``realtime``."""

import os
from contextlib import suppress
from pathlib import Path

OPTION = "realtime"
PRIORITIES = range(1, 100)
"""Of SCHED_RR in Linux."""


def prefer(priority: int | None) -> str:
    """Put all threads of this process into the real-time class SCHED_RR; None: leave them as they are.

    Threads that begin later have the class of the one that begins them. Returns why the system refuses, else "".
    """
    if priority is None:
        return ""
    try:
        for thread in Path("/proc/self/task").iterdir():
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setscheduler(int(thread.name), os.SCHED_RR, os.sched_param(priority))
    except OSError as error:
        return f"no real-time class: {error.strerror}; it needs CAP_SYS_NICE or RLIMIT_RTPRIO, and Linux"
    return ""
