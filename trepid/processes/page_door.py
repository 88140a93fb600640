"""The address of the live page of a drive, and the token without which it shows and does nothing."""

import fcntl
import os
import secrets
import socket
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from trepid.config import CONFIG_DIR, InputError, located, read
from trepid.processes.register import folder, folders
from trepid.security import certificate, load_security, on_loopback, private_key

PAGE, FOXGLOVE = "page", "foxglove"
"""Names of the processes that serve the page, and Foxglove."""
TOKEN_FILE = "page-token"
TOKEN = "TREPID_PAGE_TOKEN"  # environment variable
TOKEN_BYTES = 16
_held: dict[int, ExitStack] = {}  # port -> lock against other drives of this user; it ends with this process


@dataclass(frozen=True, slots=True)
class PageDoor:
    """Where the page is served, and to whom."""

    host: str
    port: int
    token: str

    @property
    def tls(self) -> bool:
        """True when the page is served over TLS, by the certificate of its process: beyond this machine."""
        return not _local(self.host)

    @property
    def keys(self) -> tuple[Path, Path] | None:
        """Certificate and private key of the page; None without TLS. Raises InputError without keys."""
        if not self.tls:
            return None
        keys = load_security().folder
        if keys is None:
            raise _refused(self.host)
        return certificate(keys, PAGE), private_key(keys, PAGE)

    @property
    def url(self) -> str:
        """The address for a browser. The token follows a #, so that no request carries it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{self.port}/#{self.token}"


def page_door(host: str, port: int, *, only: bool = False) -> PageDoor:
    """The door at ``host`` and ``port``, or at a free port where that one is in use.

    Raises InputError for a host beyond this machine without keys, for a host that this machine does not have, and,
    with ``only``, for a port in use.
    """
    door = PageDoor(host, port, page_token())
    if door.tls and load_security().folder is None:
        raise _refused(host)
    with suppress(OSError):
        return PageDoor(host, _reserved(host, port), door.token)
    if only:
        raise InputError(f"--page {port}: the port is in use at {host}; choose another, or leave --page out")
    try:
        return PageDoor(host, _bound(host, 0), door.token)
    except OSError as error:
        raise _wrong_host(f"{host} cannot be used: {error.strerror}; 127.0.0.1 is this machine") from error


def foxglove_port(port: int) -> int:
    """``port`` of this machine, or a free one where it is in use. Raises InputError without the extra."""
    if find_spec("foxglove") is None:
        raise InputError("--foxglove needs the SDK of Foxglove: pip install 'trepid[foxglove]'")
    with suppress(OSError):
        return _reserved("127.0.0.1", port)
    return _bound("127.0.0.1", 0)


def page_token() -> str:
    """The token of this user, the same for all drives until the machine restarts.

    Where no folder can hold it, one of this drive, in the environment of its processes.
    """
    if TOKEN not in os.environ:
        kept = [path for one in folders() if (path := one / TOKEN_FILE).exists()]
        with suppress(OSError, InputError):
            return (kept[0] if kept else _fresh_token()).read_text(encoding="utf-8")
        os.environ[TOKEN] = secrets.token_urlsafe(TOKEN_BYTES)
    return os.environ[TOKEN]


def _fresh_token() -> Path:
    """The file of a new token. Raises InputError and OSError where no folder can hold it."""
    path = folder() / TOKEN_FILE
    fresh = path.with_suffix(f".{os.getpid()}")
    try:
        with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
            file.write(secrets.token_urlsafe(TOKEN_BYTES))
        with suppress(FileExistsError):  # another drive was faster
            os.link(fresh, path)
    finally:
        fresh.unlink(missing_ok=True)
    return path


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


def _reserved(host: str, port: int) -> int:
    """``port``, which is free and stays reserved until its process listens there. Raises OSError.

    Seconds pass until then, in which another drive that starts finds the port free too.
    """
    if port in _held or not port:
        return _bound(host, port)
    with ExitStack() as held:
        lock = _lock_file(port)
        if lock is not None:
            fcntl.flock(held.enter_context(lock), fcntl.LOCK_EX | fcntl.LOCK_NB)
        found = _bound(host, port)
        _held[port] = held.pop_all()
    return found


def _lock_file(port: int) -> IO[str] | None:
    """The file whose lock reserves ``port``; None where no folder can hold it."""
    with suppress(OSError, InputError):
        return (folder() / f"port-{port}").open("a", encoding="utf-8")
    return None


def _bound(host: str, port: int) -> int:
    with listening(host, port) as probe:
        if port:
            probe.listen()  # SO_REUSEADDR lets two bind, and one listen
        return int(probe.getsockname()[1])


def _local(host: str) -> bool:
    return on_loopback(f"tcp/{host}:0")


def _refused(host: str) -> InputError:
    remedy = "`trepid keys create DIR` makes them, `keys: DIR` in security.yaml of the car uses them"
    return _wrong_host(f"{host}: the page leaves this machine without keys; {remedy}")


def _wrong_host(what: str) -> InputError:
    file = CONFIG_DIR / "drive.yaml"
    return InputError(located(("page_host",), what, read(file), file))
