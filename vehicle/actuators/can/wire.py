"""A CAN bus of python-can: newest frames in, frames out; its faults as OSError."""

import errno
from collections.abc import Iterable, Iterator

import can
from can.typechecking import CanFilter

from trepid.config import InputError
from vehicle.actuators.can.frames import Receiver, Sender
from vehicle.actuators.can.settings import CanSettings

BUS_OFF = 0x40  # class of error frames: linux/can/error.h, CAN_ERR_BUSOFF
SEND_TIMEOUT_S = 0.002
KERNEL_FILTERED = "socketcan"
"""The interface whose kernel drops unwanted frames. python-can itself drops them on other interfaces, and ``recv``
without waiting then returns None at the first one, so that the frames behind it would grow old unread."""
MOST_FRAMES = 1000  # read at once; a bus of 1 Mbit/s carries 90 in 10 ms


class CanWire:
    """One open bus."""

    def __init__(self, settings: CanSettings, wanted: Iterable[Receiver]) -> None:
        """Only the addresses ``wanted`` are received. Raises InputError when python-can cannot open the bus."""
        try:
            self._bus = can.Bus(interface=settings.interface, channel=settings.channel, **settings.options)
        except Exception as error:  # each interface raises its own, such as NameError without its library
            cause = error.__cause__ or error
            what = f"{type(cause).__name__}: {' '.join(str(cause).split())}"
            raise InputError(
                f"can: interface {settings.interface}, channel {settings.channel}: cannot be opened: {what}; "
                "`ip link` lists the interfaces of SocketCAN, actuator.yaml names the one to use"
            ) from error
        masks = {False: 0x7FF, True: 0x1FFFFFFF}
        filters: list[CanFilter] = [
            {"can_id": each.address, "can_mask": masks[each.extended], "extended": each.extended}
            for each in wanted
        ]
        self._wanted = {(each["can_id"], each["extended"]) for each in filters}
        if settings.interface == KERNEL_FILTERED:
            self._bus.set_filters(filters)

    def frames(self) -> Iterator[tuple[int, bool, bytes]]:
        """Address, whether it is extended, and data of every frame that waits. Raises OSError."""
        for _ in range(MOST_FRAMES):
            try:
                message = self._bus.recv(timeout=0.0)
            except (can.CanError, OSError, ValueError) as error:
                raise _failure("receiving", error) from error
            if message is None:
                return
            if message.is_error_frame and message.arbitration_id & BUS_OFF:
                raise OSError(errno.ENETDOWN, "CAN bus off")
            address = message.arbitration_id, message.is_extended_id
            if address in self._wanted and not (message.is_error_frame or message.is_remote_frame):
                yield *address, bytes(message.data)

    def send(self, sender: Sender, data: bytes) -> None:
        """Send ``data`` as a frame of ``sender``. Raises OSError."""
        message = can.Message(
            arbitration_id=sender.address, is_extended_id=sender.extended, is_fd=sender.fd, data=data
        )
        try:
            self._bus.send(message, timeout=SEND_TIMEOUT_S)
        except (can.CanError, OSError, ValueError) as error:
            raise _failure("sending", error) from error

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


def _failure(what: str, error: Exception) -> OSError:
    cause = error.__cause__ or error
    code = getattr(cause, "errno", None) or getattr(error, "error_code", None) or errno.EIO
    return OSError(code, f"CAN {what} failed: {' '.join(str(error).split())}")
