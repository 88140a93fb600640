"""A live drive: starts all processes over Zenoh, monitors them and evaluates the drive.

The launcher receives and displays messages and restarts processes that ended, so that the stop after a failure is
steered. A drive of a scenario ends at the end of its route, after the duration, at standstill after the loss of a
process, or on a signal; a drive of a real car after the duration or on a signal, at standstill.
"""

import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drive.monitor import Assigned, Monitor, Show
from drive.plan import (
    Networks,
    check_car,
    context_of,
    estimators_of,
    is_simulated,
    networks_in,
    planned,
)
from perception.estimators import misfits
from perception.lead.finder import blindness, check_lead
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.faults import EstimatorBias, LostLane
from sim_harness.scenarios.road_users import UserSensor
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight
from trepid.bus import Bus, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import InputError, car_folder
from trepid.processes.access import published_by
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.endpoint import usable_endpoint
from trepid.processes.fused import gathered
from trepid.processes.launch import Child, Fleet
from trepid.processes.page_door import FOXGLOVE, PAGE, PageDoor
from trepid.processes.register import Running, registered, ticks
from trepid.processes.settings import RECORDER, ProcessSpec, check_vehicle, load_processes
from trepid.recording.ring import ring_name
from trepid.recording.writer import check_recording
from trepid.security import LAUNCHER, session_settings
from trepid.topics import DIAGNOSTICS
from vehicle.keys.check import check_keys

RECORDER_READY_S = (
    5.0  # longest wait for the recorder; a drive without its first steps is recorded all the same
)


def has_simulator() -> bool:
    """True when the processes of the car in use contain a simulator, so that a drive needs a scenario."""
    return is_simulated(load_processes())


def drive(
    scenario: Scenario | None,
    settings: DriveSettings,
    *,
    seed: int,
    show: Show,
    say: Callable[[str], None] = lambda _: None,
    record: Path | None = None,
    raw_images: bool = False,
    duration_s: float | None = None,
    chosen: Networks | None = None,
    page: PageDoor | None = None,
    foxglove: int | None = None,
) -> dict[str, Any]:
    """Drive ``scenario`` live, or without one the real car in use, and return its row of ``drive --json``.

    ``chosen``: estimators of the real car instead of those of its processes. ``page``: where its live page is
    served, ``foxglove``: the port of the server for Foxglove; None: nowhere.

    Raises InputError for a scenario that only the lock-step loop can simulate, for invalid configuration, for an
    endpoint in use, and for a process that does not start.
    """
    recorded = record is not None or settings.ring.max_mb > 0
    served = {PAGE: page is not None, FOXGLOVE: foxglove is not None}
    specs, estimators, networks, remark = _plan(scenario, recorded=recorded, chosen=chosen, **served)
    if record is not None:
        check_recording(record)
    offset_ns = epoch_offset_ns()
    clock = epoch_clock(offset_ns)
    endpoint = usable_endpoint()
    check_keys([spec.name for spec in specs])
    secured = session_settings(LAUNCHER, publishes=published_by(specs), listen=endpoint)
    car = car_folder()
    what = scenario.name if scenario is not None else car.name if car is not None else "the car"
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
    context = context_of(scenario, estimators, seed, networks)
    context |= {"raw_images": raw_images}
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
            started=recorder_awaited(bus) if record is not None else lambda _: None,
        ) as fleet,
        woken_by_exits(bus),
        registered(running),
    ):
        for name, why in misfits().items():
            say(f"the estimator {name} does not run: {why}")
        say(f"{what}: {len(specs)} processes at {endpoint}; `trepid status` shows them")
        if any(spec.name == PAGE for spec in specs):
            say(f"live page: {running.page}")
        if any(spec.name == FOXGLOVE for spec in specs):
            say(f"Foxglove or Lichtblick: open the connection ws://127.0.0.1:{foxglove}")
        assigned = Assigned(scenario, estimators, duration_s, what, endpoint, remark)
        monitor = Monitor(bus, clock, fleet, assigned, settings, show)
        if monitor.wait_until_ready(signals):
            monitor.watch(signals)
        return monitor.row(seed)


def _plan(
    scenario: Scenario | None, *, recorded: bool, chosen: Networks | None, page: bool, foxglove: bool
) -> tuple[tuple[ProcessSpec, ...], tuple[str, ...], dict[str, str], str]:
    """The processes of the drive, its estimators, the files of its driving networks, and a remark about its sight.

    Raises InputError where they do not fit scenario or car.
    """
    if scenario is not None:
        for what in lockstep_only(scenario):
            raise InputError(f"scenario {scenario.name}: {what} acts in lock-step only: trepid sim run")
    own = planned(load_processes(), scenario, recorded=recorded, chosen=chosen, page=page, foxglove=foxglove)
    estimators = estimators_of(own, scenario)
    check_vehicle(own)
    check_lead(own)
    if scenario is None:
        check_car(own)
    else:
        check_configuration([scenario])
    specs = tuple(sorted(gathered(own), key=lambda spec: spec.name != RECORDER))
    _check_losable(specs, scenario)
    senses = scenario is not None and scenario.road_users_by is not UserSensor.CAMERA
    return specs, estimators, networks_in(own), "" if senses else blindness(own)


def recorder_awaited(bus: Bus) -> Callable[[Child], None]:
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


def _check_losable(specs: Iterable[ProcessSpec], scenario: Scenario | None) -> None:
    """Raise InputError when a fault of the scenario concerns a process that does not run by itself."""
    names = {spec.name for spec in specs}
    for fault in scenario.faults if scenario is not None else ():
        process = getattr(fault, "process", None)
        if process is not None and process not in names:
            raise InputError(
                f"the fault {fault.kind} of the scenario concerns {process!r}, which is "
                f"no process of its own in this drive; there are {', '.join(sorted(names))}"
            )


def lockstep_only(scenario: Scenario) -> Iterator[str]:
    """The parts of ``scenario`` that a live drive cannot simulate."""
    if scenario.sight is Sight.TRUTH:
        yield "sight: truth"
    if scenario.leads_by is LeadSensor.MODELLED:
        yield "lead_sensor: modelled"
    yield from (fault.kind for fault in scenario.faults if isinstance(fault, EstimatorBias | LostLane))


@contextmanager
def woken_by_exits(bus: Bus) -> Iterator[None]:
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
