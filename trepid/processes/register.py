"""The drives that run on this machine: one small file each, by which `trepid status` finds them."""

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import ValidationError

from trepid.config import InputError, Settings

PROCESS = "process "
"""Beginning of the names of values in the launcher's report, followed by the name of a process; JSON."""
END = "end"
"""Value of the last report of the launcher: why the drive ended, and how it was judged."""
PROBLEMS = "problems"
"""Name of the value in that report with its problems alone, without what the car does."""
WAITS = "waits"
"""Value of the reports before the beginning of the drive: what it waits for."""


class Running(Settings):
    """A running drive."""

    pid: int  # of the launcher
    started_ticks: (
        int  # field 22 of /proc/PID/stat: distinguishes the launcher from a later process with its pid
    )
    vehicle_name: str
    endpoint: str
    clock_offset_ns: int
    car: str | None  # folder of the car
    what: str  # name of the scenario, or of the car
    page: str | None = None  # address of the live page, with its token
    ring: str | None = None  # name of the ring of its last minutes; None: it writes none


def folder() -> Path:
    """Folder of the register in which this process writes, for this user alone.

    The first that can be made, in ``$XDG_RUNTIME_DIR`` or in the folder for temporary files, and that no other user
    owns. Raises InputError without one.
    """
    problem = ""
    for path in _places()[
        0 if os.environ.get("XDG_RUNTIME_DIR") else 1 :
    ]:  # /run/user ends with the last login
        try:
            path.mkdir(mode=0o700, exist_ok=True)
        except OSError as error:
            problem = f"{path}: cannot be created: {error.strerror}"
        else:
            if _is_own(path):
                return path
            problem = f"{path}: belongs to another user"
    raise InputError(f"{problem}; set XDG_RUNTIME_DIR to a folder of your own")


def folders() -> list[Path]:
    """The folders of the register that this user owns.

    A drive and the shell of its user can have different ones: a service of the system has no ``$XDG_RUNTIME_DIR``.
    """
    return [path for path in _places() if _is_own(path)]


def _places() -> tuple[Path, Path]:
    user = os.getuid()
    runtime = os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{user}"
    return Path(runtime) / "trepid", Path(tempfile.gettempdir()) / f"trepid-{user}"


def _is_own(path: Path) -> bool:
    """False also for a link of another user, which may lead to a folder of this one."""
    try:
        return path.lstat().st_uid == os.getuid()
    except OSError:
        return False


def ticks(pid: int) -> int | None:
    """Start of the process in clock ticks since boot; None when it does not run."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] in "ZX" else int(fields[19])


@contextmanager
def register_drive(drive: Running) -> Iterator[None]:
    """List ``drive`` while it runs. A register that cannot be written does not prevent a drive."""
    path = None
    with suppress(OSError, InputError):
        path = folder() / f"{drive.pid}.json"
        path.write_text(drive.model_dump_json(), encoding="utf-8")
    try:
        yield
    finally:
        if path is not None:
            with suppress(OSError):
                path.unlink()


def running() -> list[Running]:
    """The drives of this user that run, the oldest first; entries of killed launchers are removed."""
    found = []
    for path in (path for one in folders() for path in one.glob("*.json")):
        try:
            drive = Running.model_validate_json(path.read_text(encoding="utf-8"))
        except (OSError, ValidationError):
            continue  # it has just ended, or is being written
        if ticks(drive.pid) == drive.started_ticks:
            found.append(drive)
        else:
            path.unlink(missing_ok=True)
    return sorted(found, key=lambda drive: drive.started_ticks)


def choose(endpoint: str | None, drives: Sequence[Running]) -> Running:
    """The one of the running ``drives`` at ``endpoint``, or the only one. Raises InputError."""
    if not drives:
        raise InputError("no drive runs on this machine for this user; `trepid drive` starts one")
    found = [drive for drive in drives if endpoint in (None, drive.endpoint)]
    if len(found) == 1:
        return found[0]
    known = "; ".join(f"--endpoint {drive.endpoint} ({drive.what}, pid {drive.pid})" for drive in drives)
    if not found:
        raise InputError(f"no drive runs at {endpoint}; there is {known}")
    raise InputError(f"{len(found)} drives run; choose one: {known}")
