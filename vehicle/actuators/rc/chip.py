"""A PCA9685 that drives a car: under guard, checked for a loss of power, opened when it appears."""

import errno
import os
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

from trepid.config import InputError
from vehicle.actuators.rc.guard import Guard
from vehicle.actuators.rc.i2c import open_i2c
from vehicle.actuators.rc.pca9685 import Pca9685
from vehicle.actuators.rc.settings import ChipSettings

CHECK_EVERY = 50  # writes, half a second: whether the chip has lost its power
RETRY_S = 0.1  # between attempts to open a board
Opened = TypeVar("Opened")


class GuardedChip:
    """A PCA9685, which goes on with its last pulses when nothing comes: a guard watches this process."""

    def __init__(
        self, settings: ChipSettings, rest_us: Mapping[int, float], neutral_us: Mapping[int, float]
    ) -> None:
        """``rest_us``: pulse [µs] of each channel at rest; ``neutral_us``: of those that take the drive away.

        Raises OSError.
        """
        device = open_i2c(settings.bus, settings.address, alone=True)
        self.chip = Pca9685(device, frequency_hz=settings.frequency_hz, oscillator_hz=settings.oscillator_hz)
        self._writes = self._resets = 0
        self._rest_us = rest_us
        try:
            self.begin()
            self._guard = Guard(settings, neutral_us)
        except OSError:
            self.chip.close()
            raise

    def begin(self) -> None:
        """Set the pulses of the start: those at rest."""
        self.chip.set_up(self._rest_us)

    def write(self, pulses_us: Mapping[int, float], *, now_s: float) -> None:
        """Set the pulses. Raises OSError, once, when the chip had lost its power; it is then at rest again."""
        self._writes += 1
        if self._writes % CHECK_EVERY == 0 and not self.chip.is_set_up():
            self._resets += 1
            self.chip.set_up(self._rest_us)
            raise OSError(errno.EIO, "the PCA9685 had lost its settings: look at its power")
        self.chip.write(pulses_us)
        self._guard.alive()

    def values(self) -> tuple[tuple[str, str], ...]:
        """Number of losses of power."""
        return (("resets", str(self._resets)),)

    def close(self) -> None:
        """End the guard, release the bus."""
        self._guard.close()
        self.chip.close()


def open_within(wait_s: float, open_one: Callable[[], Opened], place: str, remedy: str) -> Opened:
    """What ``open_one`` opens, tried for ``wait_s``. Raises InputError with ``place``, the fault and ``remedy``."""
    deadline_s = time.monotonic() + wait_s
    while True:
        try:
            return open_one()
        except OSError as error:
            if time.monotonic() >= deadline_s:
                what = " ".join((os.strerror(error.errno) if error.errno else str(error)).split())
                raise InputError(f"{place}: cannot be opened: {what}; {remedy}") from error
            time.sleep(RETRY_S)
