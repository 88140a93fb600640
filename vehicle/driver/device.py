"""Input devices of Linux as streams of fixed-size events; unplugged and plugged in again without a restart.

A device is a character device, or a FIFO that carries the same bytes.
"""

import os
import stat
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trepid.config import InputError

BATCH = 64  # events per read


class EventDevice:
    """The events of one device, read without waiting."""

    def __init__(self, path: Path, layout: struct.Struct) -> None:
        """Open the device at ``path``. Raises InputError when it does not exist or may not be read."""
        self._path, self._layout = path, layout
        self._rest = b""
        self._fd: int | None = None
        self.fresh = True
        """The device was opened since the last read: earlier events say nothing about it."""
        try:
            mode = path.stat().st_mode
            self._fd = _open(path)
        except PermissionError as error:
            raise InputError(
                f"{path}: may not be read; add your user to the group `input`, or change `device` in driver.yaml"
            ) from error
        except OSError as error:
            raise InputError(
                f"{path}: no input device: {error.strerror}; plug it in, or change `device` in driver.yaml"
            ) from error
        if not (stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)):
            self.close()
            raise InputError(f"{path}: is no input device; change `device` in driver.yaml")

    def read(self) -> Iterator[tuple[Any, ...]] | None:
        """The events since the last call; None while the device is gone. Each call then tries to open it again."""
        self.fresh = self._fd is None
        if self._fd is None:
            self._reopen()
        data = b""
        while self._fd is not None:
            try:
                part = os.read(self._fd, BATCH * self._layout.size)
            except BlockingIOError:
                break
            except OSError:
                self.close()
                break
            if not part:  # end of a FIFO: its writer has closed it
                self.close()
            data += part
        if self._fd is None:
            self._rest = b""
            return None
        data = self._rest + data
        whole = len(data) - len(data) % self._layout.size
        self._rest = data[whole:]
        return self._layout.iter_unpack(data[:whole])

    def _reopen(self) -> None:
        try:
            self._fd = _open(self._path)
        except OSError:
            self._fd = None  # it is still gone

    def close(self) -> None:
        """Close the device; the next read opens it again."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None


def _open(path: Path) -> int:
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
