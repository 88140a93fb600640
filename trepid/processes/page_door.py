"""The address of the live page of a drive, and the token without which it shows and does nothing."""

import os
import secrets
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from trepid.config import CONFIG_DIR, InputError, fault_line, read
from trepid.processes.endpoint import free_port, reserve_port
from trepid.processes.register import folder, folders
from trepid.security import certificate, load_security, on_loopback, private_key

PAGE, FOXGLOVE = "page", "foxglove"
"""Names of the processes that serve the page, and Foxglove."""
TOKEN_FILE = "page-token"
TOKEN = "TREPID_PAGE_TOKEN"  # environment variable
TOKEN_BYTES = 16


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
            raise _missing_keys(self.host)
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
        raise _missing_keys(host)
    with suppress(OSError):
        return PageDoor(host, reserve_port(host, port), door.token)
    if only:
        raise InputError(f"--page {port}: the port is in use at {host}; choose another, or leave --page out")
    try:
        return PageDoor(host, free_port(host, 0), door.token)
    except OSError as error:
        raise _wrong_host(f"{host} cannot be used: {error.strerror}; 127.0.0.1 is this machine") from error


def foxglove_port(port: int) -> int:
    """``port`` of this machine, or a free one where it is in use. Raises InputError without the extra."""
    if find_spec("foxglove") is None:
        raise InputError("--foxglove needs the SDK of Foxglove: pip install 'trepid[foxglove]'")
    with suppress(OSError):
        return reserve_port("127.0.0.1", port)
    return free_port("127.0.0.1", 0)


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


def _local(host: str) -> bool:
    return on_loopback(f"tcp/{host}:0")


def _missing_keys(host: str) -> InputError:
    remedy = "`trepid keys create DIR` makes them, `keys: DIR` in security.yaml of the car uses them"
    return _wrong_host(f"{host}: the page leaves this machine without keys; {remedy}")


def _wrong_host(what: str) -> InputError:
    file = CONFIG_DIR / "drive.yaml"
    return InputError(fault_line(("page_host",), what, read(file), file))
