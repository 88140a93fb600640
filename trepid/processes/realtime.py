"""The real-time class of a process: its option ``realtime``."""

import os
from contextlib import suppress
from pathlib import Path

OPTION = "realtime"
PRIORITIES = range(1, 100)
"""Of SCHED_RR in Linux."""


def prefer(priority: int | None) -> str:
    """Put all threads of this process into the real-time class SCHED_RR; None: leave them as they are.

    Threads and processes that begin later have the class of the thread that begins them. Returns why the system
    refuses, else "".
    """
    if priority is None:
        return ""
    done: set[int] = set()
    try:
        while new := {int(thread.name) for thread in Path("/proc/self/task").iterdir()} - done:
            for thread in new:
                with suppress(ProcessLookupError):  # it has ended
                    os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
            done |= new
    except OSError as error:
        return f"no real-time class: {error.strerror}; it needs CAP_SYS_NICE or RLIMIT_RTPRIO, and Linux"
    return ""


def leave() -> None:
    """Put the calling thread, and what it begins from here on, back into the normal class."""
    if hasattr(os, "sched_setscheduler"):  # Linux
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
