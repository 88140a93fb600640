"""Guard of a board without a watchdog: a process that takes the drive away when its parent falls silent.

The parent writes a byte with every command. No byte for ``guard_s`` (the parent is frozen or starved) or a closed
pipe (it has ended, or has closed the board) sets the pulses without drive; the guard ends with the pipe. It cannot
help when the whole computer stops.
"""

import errno
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress

from trepid.config import ROOT
from vehicle.actuators.rc.i2c import open_i2c
from vehicle.actuators.rc.pca9685 import Pca9685
from vehicle.actuators.rc.settings import ChipSettings

ALIVE = b"."
REPEAT_S = 0.05  # neutral is set again this often: a parent that wakes up may write in between
LAST_TRIES = 15  # to set neutral after the end of the parent, when the bus refuses it
START_S = 10.0


class WatchSettings(ChipSettings):
    """The chip that a guard watches, with the pulse [µs] of each channel that takes the drive away."""

    neutral_us: Mapping[int, float]


class Guard:
    """The parent's end."""

    def __init__(self, settings: ChipSettings, neutral_us: Mapping[int, float]) -> None:
        """Start the process and wait until it watches. Raises OSError."""
        chip = {name: getattr(settings, name) for name in ChipSettings.model_fields}
        options = WatchSettings(**chip, neutral_us=neutral_us).model_dump_json()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vehicle.actuators.rc.guard", options],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        ready, _, _ = select.select([self._process.stdout], [], [], START_S)
        if not ready or not self._process.stdout.readline():
            self._process.kill()
            self.close()
            raise OSError(errno.ECHILD, "the guard of the PCA9685 did not start")

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def alive(self) -> None:
        """Report that the parent works. Raises OSError when the guard has ended, or has not read for minutes."""
        try:
            os.write(self._pipe, ALIVE)
        except OSError as error:
            raise OSError(errno.ECHILD, "the guard of the PCA9685 has ended or is frozen") from error

    def close(self) -> None:
        """End the guard, which takes the drive away."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def watch(settings: WatchSettings, pipe: int) -> None:
    """Watch ``pipe`` until it closes."""
    device = open_i2c(settings.bus, settings.address)
    chip = Pca9685(device, frequency_hz=settings.frequency_hz, oscillator_hz=settings.oscillator_hz)
    print("watching", flush=True)
    wait_s = settings.guard_s
    while True:
        ready, _, _ = select.select([pipe], [], [], wait_s)
        if not ready:
            wait_s = REPEAT_S
            with suppress(OSError):  # tried again
                chip.write(settings.neutral_us)
        elif os.read(pipe, 4096):
            wait_s = settings.guard_s
        else:
            break
    for _ in range(LAST_TRIES):
        try:
            chip.write(settings.neutral_us)
            return
        except OSError:
            time.sleep(REPEAT_S)


if __name__ == "__main__":
    watch(WatchSettings.model_validate_json(sys.argv[1]), sys.stdin.fileno())
