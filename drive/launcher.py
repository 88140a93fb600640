"""A live drive: starts all processes over Zenoh, monitors them and evaluates the drive.

The launcher receives and displays messages and restarts processes that ended, so that the stop after a failure is
steered. A drive ends at the end of its course, after the duration, at standstill after the loss of a process, or on
a signal; a real car stands before its processes end.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from drive.course import Course, Findings
from drive.log import DriveLog
from drive.monitor import Monitor, Show, missing_processes
from drive.plan import (
    context_of,
    networks_in,
    plan_processes,
)
from trepid.bus import Bus, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import car_folder
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.endpoint import usable_endpoint
from trepid.processes.fused import gather_specs
from trepid.processes.launch import Child, Fleet
from trepid.processes.page_door import FOXGLOVE, PAGE, PageDoor
from trepid.processes.register import Running, register_drive, ticks
from trepid.processes.settings import RECORDER, ProcessSpec, check_vehicle, load_processes, published_keys
from trepid.recording.ring import ring_name
from trepid.recording.writer import check_recording
from trepid.security import LAUNCHER, session_settings
from trepid.topics import DIAGNOSTICS
from vehicle.keys_check import check_keys

RECORDER_READY_S = (
    5.0  # longest wait for the recorder; a drive without its first steps is recorded all the same
)


def drive(
    course: Course,
    settings: DriveSettings,
    *,
    seed: int,
    show: Show,
    say: Callable[[str], None] = lambda _: None,
    record: Path | None = None,
    raw_images: bool = False,
    page: PageDoor | None = None,
    foxglove: int | None = None,
) -> dict[str, Any]:
    """Drive ``course`` live and return the row of ``drive --json``.

    ``page``: where its live page is served, ``foxglove``: the port of the server for Foxglove; None: nowhere.

    Raises InputError for invalid configuration, for an endpoint in use, and for a process that does not start.
    """
    recorded = record is not None or settings.ring.max_mb > 0
    served = {PAGE: page is not None, FOXGLOVE: foxglove is not None}
    plan = plan_of(course, recorded=recorded, **served)
    specs, what = plan.specs, course.name
    if record is not None:
        check_recording(record)
    offset_ns = epoch_offset_ns()
    clock = epoch_clock(offset_ns)
    endpoint = usable_endpoint()
    check_keys([spec.name for spec in specs])
    secured = session_settings(LAUNCHER, publishes=published_keys(specs), listen=endpoint)
    car = car_folder()
    running = Running(
        pid=os.getpid(),
        started_ticks=ticks(os.getpid()) or 0,
        vehicle_name=settings.vehicle_name,
        endpoint=endpoint,
        clock_offset_ns=offset_ns,
        car=str(car) if car else None,
        what=what,
        page=page.url if page is not None else None,
        ring=ring_name(now_s=time.time()) if record is None and settings.ring.max_mb > 0 else None,
    )
    context = context_of(course, plan.estimators, seed, plan.networks)
    # a simulated world stands until the launcher awaits no process any more
    context |= {"raw_images": raw_images, "awaits_release": True}
    if page is not None:
        drive_id = f"{running.pid}-{offset_ns}"
        context["page"] = {"host": page.host, "port": page.port, "what": what, "drive": drive_id}
    if foxglove is not None:
        context["foxglove"] = {"port": foxglove, "what": what}
    if record is not None:
        context["record"] = str(record.resolve())
    else:
        context["ring"] = running.ring
        context["record_folder"] = str(settings.record_folder.expanduser().resolve())
    with (
        caught_signals() as signals,
        open_bus(settings.vehicle_name, clock, listen=endpoint, further=secured) as bus,
        Fleet(
            specs,
            vehicle_name=settings.vehicle_name,
            endpoint=endpoint,
            clock_offset_ns=offset_ns,
            context=context,
            started=recorder_wait(bus) if record is not None else lambda _: None,
        ) as fleet,
        wake_by_exits(bus),
        register_drive(running),
    ):
        for name, why in plan.findings.misfits.items():
            say(f"the estimator {name} does not run: {why}")
        say(f"{what}: {len(specs)} processes at {endpoint}; `trepid status` shows them")
        addresses = {
            PAGE: f"live page: {running.page}",
            FOXGLOVE: f"Foxglove or Lichtblick: open the connection ws://127.0.0.1:{foxglove}",
        }
        shown = telling(
            show, say, {spec.name: addresses[spec.name] for spec in specs if spec.name in addresses}
        )
        monitor = Monitor(bus, clock, fleet, course, plan.estimators, settings, shown)
        if monitor.wait_until_ready(signals):
            monitor.watch(signals)
        return monitor.row(seed, remark=plan.findings.remark)


def telling(show: Show, say: Callable[[str], None], addresses: dict[str, str]) -> Show:
    """``show``, which also passes to ``say`` the line of each of ``addresses`` once there is something to see.

    Its process then listens there, and all that the drive waits for have reported, the camera among them.
    """
    waiting = dict(addresses)

    def show_drive(log: DriveLog, fleet: Fleet, elapsed_s: float) -> None:
        if waiting and not missing_processes(log, fleet):
            for name in waiting.keys() & log.diagnostics.keys():
                say(waiting.pop(name))
        show(log, fleet, elapsed_s)

    return show_drive


class Plan(NamedTuple):
    """What runs in a drive."""

    specs: tuple[ProcessSpec, ...]
    estimators: tuple[str, ...]
    networks: Mapping[str, str]  # file of each driving network, by the name of its estimator
    findings: Findings


def plan_of(course: Course, *, recorded: bool, page: bool, foxglove: bool) -> Plan:
    """The checked processes of a drive of ``course``. Raises InputError where they fit neither course nor car."""
    own = plan_processes(load_processes(), course, recorded=recorded, page=page, foxglove=foxglove)
    estimators = course.estimators(own)
    check_vehicle(own)
    findings = course.check(own)
    specs = tuple(sorted(gather_specs(own), key=lambda spec: spec.name != RECORDER))
    return Plan(specs, estimators, networks_in(own), findings)


def recorder_wait(bus: Bus) -> Callable[[Child], None]:
    """A function that waits until a recorder that has just been started hears the other processes.

    The recording of a drive then holds the first step of every node, which a replay begins with.
    """
    heard = bus.latest(DIAGNOSTICS, wakes=False)

    def wait(child: Child) -> None:
        until_s = time.monotonic() + RECORDER_READY_S
        while child.spec.name == RECORDER and child.alive and time.monotonic() < until_s:
            beat = heard.take()
            if beat is not None and beat.process == RECORDER:
                return
            time.sleep(0.01)

    return wait


@contextmanager
def wake_by_exits(bus: Bus) -> Iterator[None]:
    """The end of a process ends the wait of ``bus``, so that it is reported at once."""
    before = signal.signal(signal.SIGCHLD, lambda *_: bus.wake())
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)


@contextmanager
def caught_signals() -> Iterator[list[str]]:
    """A list of the termination signals received so far, as text."""
    caught: list[str] = []
    names = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def catch(number: int, _: object) -> None:
        caught.append(f"stopped by {signal.Signals(number).name}")

    before = {number: signal.signal(number, catch) for number in names}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
