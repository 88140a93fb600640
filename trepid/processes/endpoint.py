"""The Zenoh endpoint at which the processes of a drive meet, and the ports that the drive takes.

Seconds pass between the choice of a port and the process that listens there; another drive that starts meanwhile
would find the port free too. On Linux a name in the abstract namespace of Unix sockets reserves it: all users of
the machine see that name, it has the same scope as the port (the network namespace), and it ends with its process.
Elsewhere a lock on a file does so among the drives of one user.
"""

import fcntl
import os
import shutil
import socket
import sys
import tempfile
from contextlib import ExitStack, closing, suppress
from pathlib import Path

from trepid.bus import free_endpoint
from trepid.config import CONFIG_DIR, InputError, fault_line, read
from trepid.processes.register import folder
from trepid.security import drive_endpoint, refuse_open_endpoints

_held: dict[int, ExitStack] = {}  # port -> its reservation; it ends with this process


def listening(host: str, port: int) -> socket.socket:
    """A socket bound to ``host`` and ``port``. Raises OSError."""
    bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    try:
        bound.setsockopt(
            socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
        )  # the connections of a former one may linger
        bound.bind((host, port))
    except OSError:
        bound.close()
        raise
    return bound


def free_port(host: str, port: int) -> int:
    """``port`` of ``host``, or with 0 a free one, where nothing listens. Raises OSError."""
    with listening(host, port) as probe:
        if port:
            probe.listen()  # SO_REUSEADDR lets two bind, and one listen
        return int(probe.getsockname()[1])


def reserve_port(host: str, port: int) -> int:
    """``port`` of ``host``, which is free and stays reserved until this process ends. Raises OSError."""
    if port in _held or not port:
        return free_port(host, port)
    with ExitStack() as held:
        _reserve(port, held)
        found = free_port(host, port)
        _held[port] = held.pop_all()
    return found


def _reserve(port: int, held: ExitStack) -> None:
    """Reserve ``port`` until ``held`` ends. Raises OSError where another process has reserved it."""
    if sys.platform == "linux":
        name = held.enter_context(socket.socket(socket.AF_UNIX))
        name.bind(f"\0trepid-port-{port}")
        return
    lock = None
    with suppress(OSError, InputError):  # no folder can hold it
        lock = held.enter_context((folder() / f"port-{port}").open("a", encoding="utf-8"))
    if lock is not None:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


LOOPBACK, LOOPBACK_S = "127.0.0.1", 1.0
SHARED_MEMORY = Path("/dev/shm")  # of Linux
SHARED_BYTES = 32_000_000  # Zenoh: 16 MiB of the camera's images, and 1.3 MB of each of ten processes


def usable_endpoint() -> str:
    """The endpoint of a drive of the car in use, at which nothing listens; it stays reserved for this process.

    Raises InputError with the place of ``listen`` when it may not, or cannot, be used, and where the processes of a
    drive could not meet: the loopback interface cannot be reached, or there is no shared memory.
    """
    _check_loopback()
    _check_shared_memory(SHARED_MEMORY)
    endpoint = drive_endpoint(free_endpoint())
    if not endpoint.startswith("tls/"):
        try:
            refuse_open_endpoints({"listen/endpoints": [endpoint], "connect/endpoints": []})
        except InputError as error:
            raise _wrong_listen(str(error)) from error
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        reserve_port(host.strip("[]"), int(port))
    except OSError as error:
        what = f"{endpoint} cannot be used: {error.strerror}; give another HOST:PORT, or null for a free port"
        raise _wrong_listen(what) from error
    return endpoint


def _check_loopback() -> None:
    """Raise InputError where nothing reaches 127.0.0.1, as in a container whose interface lo is down.

    A socket can listen there all the same, so that the processes of a drive would wait for each other in vain.
    """
    with closing(listening(LOOPBACK, 0)) as listener, socket.socket() as caller:
        listener.listen()
        caller.settimeout(LOOPBACK_S)
        try:
            caller.connect(listener.getsockname())
        except OSError as error:
            raise InputError(
                f"{LOOPBACK} cannot be reached: {error.strerror or error}; the processes of a drive meet at the"
                " loopback interface: `ip link set lo up`"
            ) from error


def _check_shared_memory(folder: Path) -> None:
    """Raise InputError where ``folder`` cannot hold the shared memory of a drive; no folder: another system.

    A segment larger than the free space can be made, and kills the process that writes to it.
    """
    if not folder.exists():
        if os.uname().sysname == "Linux":
            raise InputError(
                f"{folder}: no such folder; a drive needs shared memory: `mount -t tmpfs tmpfs {folder}`"
            )
        return
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise InputError(f"{folder} cannot be used: {error.strerror}; a drive needs shared memory") from error
    if free < SHARED_BYTES:
        raise InputError(
            f"{folder}: {free / 1e6:.1f} MB are free, a drive needs {SHARED_BYTES / 1e6:.0f} MB of shared memory;"
            " give a container more (`docker run --shm-size=256m`), or remove old files there"
        )


def _wrong_listen(what: str) -> InputError:
    file = CONFIG_DIR / "security.yaml"
    return InputError(fault_line(("listen",), what, read(file), file))
