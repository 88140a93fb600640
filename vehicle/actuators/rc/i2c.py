"""I2C devices: ``/dev/i2c-N`` of Linux, or a socket that carries the same transfers.

Linux: Documentation/i2c/dev-interface.rst. Socket (``unix:PATH``, SOCK_SEQPACKET): a packet is one transfer, its
first byte 0 (write) or 1 (read), then the address; then the bytes to write, or register and number of bytes to
read. The answer is 0 and the bytes read, or 1 for a device that does not acknowledge.
"""

import errno
import fcntl
import os
import socket
from typing import Protocol

I2C_SLAVE = 0x0703  # linux/i2c-dev.h
TIMEOUT_S = 0.2
UNIX = "unix:"
WRITE, READ = 0, 1


class I2cDevice(Protocol):
    """One device on a bus. All methods raise OSError when it does not acknowledge."""

    def write(self, data: bytes) -> None:
        """Send ``data``: the register, then its bytes."""
        ...

    def read(self, register: int, count: int) -> bytes:
        """``count`` bytes from ``register`` on."""
        ...

    def close(self) -> None:
        """Release the bus."""
        ...


class LinuxI2c:
    """A device on ``/dev/i2c-N``."""

    def __init__(self, path: str, address: int, *, alone: bool) -> None:
        """``alone``: refuse a bus that another process of Trepid has taken."""
        self._fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        try:
            if alone:
                fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(self._fd, I2C_SLAVE, address)
        except OSError:
            self.close()
            raise

    def write(self, data: bytes) -> None:
        """Send ``data`` in one transfer."""
        if os.write(self._fd, data) != len(data):
            raise OSError(errno.EIO, "the I2C device took only a part")

    def read(self, register: int, count: int) -> bytes:
        """``count`` bytes from ``register`` on."""
        self.write(bytes([register]))
        data = os.read(self._fd, count)
        if len(data) != count:
            raise OSError(errno.EIO, "the I2C device sent only a part")
        return data

    def close(self) -> None:
        """Close the bus."""
        os.close(self._fd)


class SocketI2c:
    """A device behind a socket."""

    def __init__(self, path: str, address: int) -> None:
        self._path, self._address = path, address
        self._socket = _connect(path)

    def write(self, data: bytes) -> None:
        """Send ``data`` in one transfer."""
        self._transfer(bytes([WRITE, self._address]) + data)

    def read(self, register: int, count: int) -> bytes:
        """``count`` bytes from ``register`` on."""
        return self._transfer(bytes([READ, self._address, register, count]))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _transfer(self, packet: bytes) -> bytes:
        if self._socket.fileno() < 0:
            self._socket = _connect(self._path)
        try:
            self._socket.send(packet)
            answer = self._socket.recv(256)
        except OSError:
            self._socket.close()  # a late answer would be taken for that of the next transfer
            raise
        if not answer:
            self._socket.close()
            raise OSError(errno.EPIPE, "the I2C bus is closed")
        if answer[0]:
            raise OSError(errno.EREMOTEIO, f"no I2C device at address 0x{self._address:02x}")
        return answer[1:]


def _connect(path: str) -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    made.settimeout(TIMEOUT_S)
    try:
        made.connect(path)
    except OSError:
        made.close()
        raise
    return made


def open_i2c(bus: str, address: int, *, alone: bool = False) -> I2cDevice:
    """The device at ``address`` of ``bus``. Raises OSError."""
    if bus.startswith(UNIX):
        return SocketI2c(bus.removeprefix(UNIX), address)
    return LinuxI2c(bus, address, alone=alone)
