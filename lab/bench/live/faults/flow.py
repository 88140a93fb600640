"""The course of one drive: cruise, fault, stop, cause removed, cruise again; and what became of the drive."""

import os
import random
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from lab.bench.live.faults.acts import inject
from lab.bench.live.faults.catalogue import Fault
from lab.bench.live.faults.course import SPEED_MPS
from lab.bench.live.faults.drive import DriveEnded, FaultDrive, driving
from lab.bench.live.faults.episode import CALM_S, Row, judge_episode
from trepid.config import InputError

CRUISE_SHARE = 0.93
CALM_MPS2 = 0.3  # accelerations of the speed control at its speed
BEGIN_S = 75.0  # greatest time to the first motion: all processes start
CRUISE_S = 15.0  # greatest time to the cruise speed
STAND_S = 6.0  # greatest time to standstill after a fault that has to stop the car
UNHARMED_S = 2.0  # duration of a fault that must not stop it
RESUME_S = 2.0  # greatest time to start again by itself
RENEW_S = 6.0  # ... and after a new start of the supervisor
STARTED_MPS = 0.3
PHASE_S = 0.1  # injections are spread over this time, longer than any period
BY_ITSELF, RENEWED, NOT_AT_ALL, KEPT = "by itself", "after a new start", "no", "never stopped"


def drive_faults(wire: str, faults: Iterable[tuple[Fault, int]], interrupted: threading.Event) -> list[Row]:
    """Drive on ``wire`` and inject the faults in turns, each with its number; the rows of those that were injected.

    A fault that ends the drive comes last. Raises InputError when the drive does not start, and Interrupted.
    """
    rows: list[Row] = []
    with (
        tempfile.TemporaryDirectory(prefix="trepid-faults-") as folder,
        driving(Path(folder), wire, interrupted) as drive,
    ):
        begin(drive)
        with suppress(DriveEnded):
            for fault, number in faults:
                if not cruises(drive):
                    break
                rows.append({"load": round(os.getloadavg()[0], 1), "wire": wire, "number": number})
                if fault.ends_drive:
                    injected_s, _ = inject_fault(drive, fault, number)
                    end = drive.ending()
                    rows[-1] |= judge_episode(fault, drive.events, injected_s=injected_s) | {"resumed": None}
                    return [row | end for row in rows]
                rows[-1] |= episode(drive, fault, number)
        drive.interrupt()
        end = drive.ending()
    return [row | end for row in rows if "fault" in row]


def begin(drive: FaultDrive) -> None:
    """Wait until the drive has begun and the car moves. Raises InputError when the drive refuses to begin."""
    try:
        until(drive, lambda: drive.began and moves(drive), BEGIN_S)
    except DriveEnded as error:
        raise InputError(f"the drive did not begin: {drive.errors()}") from error
    drive.prefer()


def inject_fault(drive: FaultDrive, fault: Fault, number: int) -> tuple[float, Callable[[], None]]:
    """Inject ``fault`` at a moment that depends on its number."""
    phase_s = random.Random(f"{drive.wire} {fault.name} {number}").uniform(0.0, PHASE_S)
    time.sleep(phase_s)
    return inject(drive, fault, number=number)


def episode(drive: FaultDrive, fault: Fault, number: int) -> Row:
    """One fault after which the drive may go on."""
    injected_s, release = inject_fault(drive, fault, number)
    try:
        waited = until(drive, lambda: drive.stands, STAND_S if fault.stops else UNHARMED_S)
    except DriveEnded:
        return judge_episode(fault, drive.events, injected_s=injected_s) | {"resumed": None}
    finally:
        with suppress(DriveEnded):
            release()
    resumed = resume(drive) if waited or not moves(drive) else KEPT
    return judge_episode(fault, drive.events, injected_s=injected_s) | {"resumed": resumed}


def resume(drive: FaultDrive) -> str:
    """How the car starts again once the cause is gone."""
    with suppress(DriveEnded):
        if until(drive, lambda: moves(drive), RESUME_S):
            return BY_ITSELF
        drive.renew_supervisor()
        if until(drive, lambda: moves(drive), RENEW_S):
            return RENEWED
    return NOT_AT_ALL


def cruises(drive: FaultDrive) -> bool:
    """Wait until the car drives calmly at its speed; False when it does not, also after a new start."""
    drive.forget()
    if not until(drive, lambda: calm(drive), CRUISE_S):
        drive.renew_supervisor()
        if not until(drive, lambda: calm(drive), CRUISE_S):
            return False
    drive.events.applied = drive.events.applied[-int(200 * CALM_S) :]
    return True


def calm(drive: FaultDrive) -> bool:
    """The car has had its speed, and neither brake nor drive, for CALM_S."""
    events, now_s = drive.events, drive.now_s()
    places = [place for place in events.places if place.t_s > now_s - CALM_S]
    accels = [accel for t_s, accel in events.applied if t_s > now_s - CALM_S]
    long_enough = bool(events.places) and now_s - events.places[0].t_s > CALM_S
    steady = bool(places) and min(place.speed_mps for place in places) > CRUISE_SHARE * SPEED_MPS
    return long_enough and steady and bool(accels) and max(map(abs, accels)) < CALM_MPS2


def moves(drive: FaultDrive) -> bool:
    """The car moves now."""
    return bool(drive.events.places) and drive.events.places[-1].speed_mps > STARTED_MPS


def until(drive: FaultDrive, condition: Callable[[], bool], patience_s: float) -> bool:
    """Take the events of the drive until ``condition`` holds; False after ``patience_s``. Raises Ended."""
    until_s = time.monotonic() + patience_s
    while time.monotonic() < until_s:
        drive.poll()
        if condition():
            return True
    return False
