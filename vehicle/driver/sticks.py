"""Game pad and keyboard as one set of sticks and buttons.

Linux joystick API: Documentation/input/joydev/joystick-api.rst. Event devices: Documentation/input/input.rst.

A device (:class:`EventDevice`) is a character device, or a FIFO that carries the same bytes.
"""

import os
import stat
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from trepid.config import InputError
from vehicle.driver.settings import DeviceKind, DriverSettings, Gamepad, Keyboard

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


JS_EVENT = struct.Struct("=IhBB")  # time [ms], value, type, number
JS_BUTTON, JS_AXIS, JS_INIT = 0x01, 0x02, 0x80
JS_FULL = 32767.0  # value of an axis at its end
INPUT_EVENT = struct.Struct("@llHHi")  # time [s, µs], type, code, value
EV_SYN, EV_KEY = 0, 1
RELEASED, PRESSED = 0, 1  # 2 repeats a press that may be older than the device: it shows no new one
SYN_DROPPED = 3  # the kernel has lost events


class Sticks(NamedTuple):
    """Positions of sticks and buttons at one time."""

    steering: float = 0.0  # -1..1, + = left
    throttle: float = 0.0  # -1..1, + = faster, - = brake
    dead_man: bool = False
    hand: bool = False
    stop: bool = False
    record: bool = False


class DriverInput(Protocol):
    """A device that a driver holds."""

    def read(self, *, now_s: float) -> Sticks | None:
        """Sticks and buttons at ``now_s``; None while the device is gone."""
        ...

    def close(self) -> None:
        """Close the device."""
        ...


class GamepadInput:
    """A game pad at ``/dev/input/js*``."""

    def __init__(self, device: EventDevice, settings: Gamepad) -> None:
        self._device, self._settings = device, settings
        self._axes: dict[int, int] = {}
        self._buttons: dict[int, bool] = {}

    def read(self, *, now_s: float) -> Sticks | None:
        """The newest positions; an axis or button without an event is centred or released."""
        events = self._device.read()
        if events is None or self._device.fresh:
            self._axes.clear()
            self._buttons.clear()
        if events is None:
            return None
        for _, value, kind, number in events:
            if kind & ~JS_INIT == JS_AXIS:
                self._axes[number] = value
            elif kind & ~JS_INIT == JS_BUTTON:
                self._buttons[number] = bool(value)
        settings = self._settings
        return Sticks(
            steering=self._axis(settings.steering_axis, settings.steering_sign),
            throttle=self._axis(settings.throttle_axis, settings.throttle_sign),
            dead_man=self._buttons.get(settings.dead_man_button, False),
            hand=self._buttons.get(settings.hand_button, False),
            stop=self._buttons.get(settings.stop_button, False),
            record=self._buttons.get(settings.record_button, False),
        )

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def _axis(self, number: int, sign: int) -> float:
        """Position in -1..1; zero inside the dead zone, from which it rises without a step."""
        value = max(-1.0, min(1.0, sign * self._axes.get(number, 0) / JS_FULL))
        beyond = max(0.0, abs(value) - self._settings.dead_zone) / (1.0 - self._settings.dead_zone)
        return beyond if value > 0.0 else -beyond


class KeyboardInput:
    """A keyboard at ``/dev/input/event*``, which reports the release of a key, as a terminal does not."""

    def __init__(self, device: EventDevice, settings: Keyboard) -> None:
        self._device, self._settings = device, settings
        self._held: set[int] = set()
        self._steering = self._throttle = 0.0
        self._read_s: float | None = None

    def read(self, *, now_s: float) -> Sticks | None:
        """The newest state of the keys; steering and throttle move towards the held keys, else to the centre."""
        events = self._device.read()
        if events is None or self._device.fresh:
            self._held.clear()
            self._steering = self._throttle = 0.0
        if events is None:
            return None
        for _, _, kind, code, value in events:
            if kind == EV_SYN and code == SYN_DROPPED:
                self._held.clear()
            elif kind == EV_KEY and value == RELEASED:
                self._held.discard(code)
            elif kind == EV_KEY and value == PRESSED:
                self._held.add(code)
        step = self._settings.per_s * max(0.0, now_s - (now_s if self._read_s is None else self._read_s))
        self._read_s = now_s
        settings = self._settings
        self._steering = self._move_stick(self._steering, settings.left_key, settings.right_key, step)
        self._throttle = self._move_stick(self._throttle, settings.faster_key, settings.brake_key, step)
        return Sticks(
            steering=self._steering,
            throttle=self._throttle,
            dead_man=settings.dead_man_key in self._held,
            hand=settings.hand_key in self._held,
            stop=settings.stop_key in self._held,
            record=settings.record_key in self._held,
        )

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def _move_stick(self, value: float, plus: int, minus: int, step: float) -> float:
        goal = float(plus in self._held) - float(minus in self._held)
        return max(value - step, min(value + step, goal))


def open_input(settings: DriverSettings) -> DriverInput:
    """The device in ``settings``. Raises InputError when it cannot be opened."""
    if settings.kind is DeviceKind.KEYBOARD:
        return KeyboardInput(EventDevice(settings.device, INPUT_EVENT), settings.keyboard)
    return GamepadInput(EventDevice(settings.device, JS_EVENT), settings.gamepad)
