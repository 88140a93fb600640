"""Checks of the machine: clock, cores and load, disk, real-time priority.

A check that measures is two functions: the measurement, and the judgement of its numbers.
"""

import ctypes
import os
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

from cockpit.car.checks import Finding
from trepid.config import InputError
from trepid.processes.realtime import OPTION
from trepid.processes.settings import load_processes
from trepid.recording.ring import MB, ring_settings, state_folder

CLOCK_SOURCE = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
SLOW_SOURCES = frozenset({"acpi_pm", "hpet", "jiffies", "pit"})  # a microsecond and more a reading, or coarse
STEP_S = 1e-3  # of the wall clock against the monotonic one during the check
STEP_CHECK_S = 0.2
UNSYNCHRONISED = 0x40  # STA_UNSYNC of adjtimex(2)
EARLIEST_EPOCH_S = 1_700_000_000  # a clock before November 2023 was never set

MIN_CORES = 2
FREE_BYTES = 2_000_000_000  # some minutes of recording
WRITE_MBPS = 20.0  # a recorded drive writes about a third of that
SAMPLE_BYTES = 16_000_000


def clock() -> Finding:
    """Source of the clock, steps of the wall clock, and its synchronisation."""
    source = CLOCK_SOURCE.read_text().strip() if CLOCK_SOURCE.is_file() else "unknown"
    before_s = _epoch_offset_s()
    time.sleep(STEP_CHECK_S)
    return judged_clock(source, _epoch_offset_s() - before_s, time.time(), _ntp_synchronised())


def _epoch_offset_s() -> float:
    """Wall clock minus monotonic clock, by the pair of readings that took least time."""
    pairs = []
    for _ in range(9):
        began_s, epoch_s, ended_s = time.monotonic(), time.time(), time.monotonic()
        pairs.append((ended_s - began_s, epoch_s - began_s))
    return min(pairs)[1]


def judged_clock(source: str, step_s: float, epoch_s: float, synchronised: bool | None) -> Finding:
    """The clock by its source, its step during the check, its time, and NTP (None: unknown)."""
    if source in SLOW_SOURCES:
        return Finding(
            "clock",
            False,
            f"the kernel reads the clock source {source}, which is slow or coarse",
            "choose tsc in the BIOS or by the kernel option clocksource=tsc",
        )
    if abs(step_s) > STEP_S:
        return Finding(
            "clock",
            False,
            f"the wall clock stepped by {1e3 * step_s:+z.1f} ms within {STEP_CHECK_S} s",
            "let chrony or systemd-timesyncd finish before the drive, or slew instead of step",
        )
    if epoch_s < EARLIEST_EPOCH_S:
        return Finding(
            "clock",
            False,
            "the wall clock was never set",
            "set it: `timedatectl set-ntp true`, or `date --set`; recordings carry its time",
        )
    if synchronised is False:
        return Finding(
            "clock",
            True,
            f"source {source}, no steps; not synchronised by NTP",
            "`timedatectl set-ntp true`, if recordings are compared with those of other machines",
        )
    return Finding("clock", True, f"source {source}, no steps" + (", synchronised" if synchronised else ""))


def _ntp_synchronised() -> bool | None:
    """State of the kernel's clock discipline by adjtimex(2); None where the call is not available."""

    class Timex(ctypes.Structure):  # the first fields, and room for the others
        _fields_ = (
            ("modes", ctypes.c_uint),
            ("offset", ctypes.c_long),
            ("freq", ctypes.c_long),
            ("maxerror", ctypes.c_long),
            ("esterror", ctypes.c_long),
            ("status", ctypes.c_int),
            ("rest", ctypes.c_byte * 256),
        )

    if not sys.platform.startswith("linux"):
        return None
    found = Timex()
    if ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(found)) < 0:
        return None
    return not found.status & UNSYNCHRONISED


def cores() -> Finding:
    """Cores that this process may use, and their load over the last minute."""
    return judged_cores(len(os.sched_getaffinity(0)), os.getloadavg()[0])


def judged_cores(count: int, load: float) -> Finding:
    """``load`` is the number of processes that ran or waited, as a mean over a minute."""
    message = f"{count} cores, load {load:.1f} over the last minute"
    if count < MIN_CORES:
        return Finding("cores", False, message, f"a drive needs {MIN_CORES} cores: raise the limit of cores")
    remedy = "end other programs: a drive needs more than half of the cores"
    return Finding("cores", load <= count, message, remedy if load > count / 2 else "")


def disk(folder: Path, *, check: str = "disk", needed: float = FREE_BYTES) -> Finding:
    """Free space and write speed where a recording would go; ``needed`` in bytes."""
    try:
        free = shutil.disk_usage(folder).free
        if free < needed + SAMPLE_BYTES:
            return judged_disk(folder, free, None, check=check, needed=needed)
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            started_s = time.perf_counter()
            file.write(os.urandom(SAMPLE_BYTES // 16) * 16)
            file.flush()
            os.fsync(file.fileno())
            speed_mbps = SAMPLE_BYTES / 1e6 / (time.perf_counter() - started_s)
    except OSError as error:
        return Finding(check, False, f"{folder}: {error.strerror}", "change to a folder that can be written")
    return judged_disk(folder, free, speed_mbps, check=check, needed=needed)


def judged_disk(
    folder: Path, free: int, speed_mbps: float | None, *, check: str = "disk", needed: float = FREE_BYTES
) -> Finding:
    """``free`` in bytes; ``speed_mbps`` None when too little is free for a measurement."""
    message = f"{folder}: {free / 1e9:.1f} GB free"
    if free < needed or speed_mbps is None:
        return Finding(check, False, message, f"free {needed / 1e9:.1f} GB, or record to another disk")
    message += f", writes {speed_mbps:.0f} MB/s"
    if speed_mbps < WRITE_MBPS:
        return Finding(check, False, message, f"record to a disk that writes {WRITE_MBPS:.0f} MB/s")
    return Finding(check, True, message)


def ring() -> Finding:
    """Free space and write speed where the last minutes of every drive go."""
    try:
        needed = MB * ring_settings().max_mb
        folder = state_folder("ring")
        present = next(path for path in (folder, *folder.parents) if path.is_dir())
    except (InputError, OSError) as error:
        return Finding("ring", False, str(error), "correct `ring` in drive.yaml, or set XDG_STATE_HOME")
    if not needed:
        return Finding("ring", True, "no drive writes its last minutes: ring.max_mb of drive.yaml is 0")
    return disk(present, check="ring", needed=needed)


def real_time() -> Finding:
    """Permission for real-time scheduling and for negative niceness; a drive runs without."""
    soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)  # the greatest priority
    return judged_real_time(soft >= _highest_priority() or (os.geteuid() == 0 and _may_be_real_time()))


def _highest_priority() -> int:
    """Of the processes of the car in use; 1 without any, and for an invalid file, which another check reports."""
    try:
        specs = load_processes()
    except InputError:
        specs = ()
    return max((spec.options.get(OPTION) or 1 for spec in specs), default=1)


def judged_real_time(permitted: bool) -> Finding:
    """A missing permission is advice: without it the processes share the cores with all others."""
    if permitted:
        return Finding("real-time", True, "processes may run with real-time priority")
    return Finding(
        "real-time",
        True,
        "no permission for real-time priority; processes run at normal priority",
        "add `@USER - rtprio 50` to /etc/security/limits.conf, or LimitRTPRIO=50 to the systemd unit",
    )


def _may_be_real_time() -> bool:
    """Try it on this process, and go back."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True
