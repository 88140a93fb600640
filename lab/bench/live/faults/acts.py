"""How a fault is injected into a drive, and how its cause is removed again."""

import os
import signal
import subprocess
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from lab.bench.live.faults.catalogue import CAN, CLOCK_STEP_S, LAUNCHER, SIM, STARVED, Act, Fault
from lab.bench.live.faults.course import FIRST
from lab.bench.live.faults.drive import FaultDrive
from lab.bench.live.faults.inside import Order
from trepid.processes.launch import set_niceness

Release = Callable[[], None]
BUSY = 24
SPIN = "ulimit -t 20; while :; do :; done"
"""A busy program. The kernel ends it after 20 s on the processor, whatever becomes of this process."""


def inject(drive: FaultDrive, fault: Fault, *, number: int) -> tuple[float, Release]:
    """Harm ``drive``; the time of the injection on its clock [s], and what removes the cause."""
    match fault.act:
        case Act.KILL:
            drive.killed_launcher = fault.process == LAUNCHER
            pid, injected_s = drive.pid(fault.process), drive.now_s()
            os.kill(pid, signal.SIGKILL)
            return injected_s, lambda: None
        case Act.FREEZE:
            pid = drive.pid(fault.process)
            os.kill(pid, signal.SIGSTOP)
            return drive.now_s(), lambda: _resume(pid)
        case Act.STARVE:
            injected_s = drive.now_s()
            return injected_s, starve(drive)
        case Act.FILL:
            injected_s = drive.now_s()
            drive.fill_disk()
            return injected_s, drive.free_disk
    name = fault.process
    if name == "actuator":
        name = "ecu" if drive.wire == CAN else "vehicle"
    order = Order(act=fault.act, key=fault.key)
    if fault.act is Act.CLOCK:  # the clock of a simulation moves the simulated world
        simulated = name == "camera" or (name == "vehicle" and drive.wire == SIM)
        step_s = CLOCK_STEP_S if number % 2 == 0 else -CLOCK_STEP_S
        order = Order(act=fault.act, key=fault.key, clock_step_s=step_s, stamps_only=simulated)
    injected_s = drive.now_s()
    drive.order(name, order)
    return injected_s, lambda: drive.order(name, Order())


def _resume(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)


def starve(drive: FaultDrive) -> Release:
    """Put the processes of the frame on one core with BUSY programs."""
    cores = os.sched_getaffinity(0)
    names = (*STARVED, "lead", *(["vehicle"] if drive.wire == CAN else []))
    pids = [pid for name, pid in drive.pids().items() if name in names]
    core = {max(cores)}
    # Sessions of their own: Linux shares the processor between sessions.
    busy = [subprocess.Popen(["sh", "-c", SPIN], start_new_session=True) for _ in range(BUSY)]
    for popen in busy:
        set_niceness(popen.pid, FIRST)
    _move([popen.pid for popen in busy], core)
    _move(pids, core)

    def release() -> None:
        for popen in busy:
            popen.kill()
            popen.wait()
        _move(pids, cores)

    return release


def _move(pids: Iterable[int], cores: Iterable[int]) -> None:
    """Let all threads of the processes run on ``cores`` only."""
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").glob("*"):
            with suppress(ProcessLookupError):
                os.sched_setaffinity(int(task.name), cores)
