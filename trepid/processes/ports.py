"""Ports that one drive takes until its processes listen there, beside other drives and other users.

Seconds pass between the choice of a port and the process that listens there; another drive that starts meanwhile
would find the port free too. On Linux a name in the abstract namespace of Unix sockets reserves it: all users of
the machine see that name, it has the same scope as the port (the network namespace), and it ends with its process.
Elsewhere a lock on a file does so among the drives of one user.
"""

import fcntl
import socket
import sys
from contextlib import ExitStack, suppress

from trepid.config import InputError
from trepid.processes.register import folder

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


def bound(host: str, port: int) -> int:
    """``port`` of ``host``, or with 0 a free one, where nothing listens. Raises OSError."""
    with listening(host, port) as probe:
        if port:
            probe.listen()  # SO_REUSEADDR lets two bind, and one listen
        return int(probe.getsockname()[1])


def reserved(host: str, port: int) -> int:
    """``port`` of ``host``, which is free and stays reserved until this process ends. Raises OSError."""
    if port in _held or not port:
        return bound(host, port)
    with ExitStack() as held:
        _reserve(port, held)
        found = bound(host, port)
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
