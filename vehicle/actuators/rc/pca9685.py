"""The PCA9685: 16 outputs of 12 bit over I2C (NXP, PCA9685 data sheet rev. 4, sections 7.3 and 7.4).

Prescale = round(f_osc/(4096·f)) - 1; a pulse of t is t·f·4096 counts, with f as the prescale really gives it.
"""

import errno
import time
from collections.abc import Mapping

from vehicle.actuators.rc.i2c import I2cDevice

MODE1, MODE2, LED0_ON_L, PRE_SCALE = 0x00, 0x01, 0x06, 0xFE
RESTART, AUTO_INCREMENT, SLEEP, OUTDRV = 0x80, 0x20, 0x10, 0x04
COUNTS = 4096
FULL_OFF = COUNTS  # bit 4 of OFF_H: the output stays low
WAKE_S = 0.0005  # the oscillator runs so long after the end of the sleep


def prescale_of(frequency_hz: float, oscillator_hz: float) -> int:
    """The value of PRE_SCALE, 3 to 255."""
    return max(3, min(255, round(oscillator_hz / (COUNTS * frequency_hz)) - 1))


class Pca9685:
    """The chip behind an I2C device. All methods raise OSError when it does not answer as it should."""

    def __init__(self, device: I2cDevice, *, frequency_hz: float, oscillator_hz: float) -> None:
        self._device = device
        self._prescale = prescale_of(frequency_hz, oscillator_hz)
        self._counts_per_us = oscillator_hz / (self._prescale + 1) * 1e-6

    @property
    def period_us(self) -> float:
        """The time from pulse to pulse [µs]."""
        return COUNTS * self.count_us

    @property
    def count_us(self) -> float:
        """The step of a pulse [µs]."""
        return 1.0 / self._counts_per_us

    def set_up(self, pulses_us: Mapping[int, float]) -> None:
        """Set frequency and first pulses while the outputs sleep, then wake them; check by reading back."""
        if self.is_set_up():
            self.write(pulses_us)
            return
        self._device.write(bytes([MODE1, AUTO_INCREMENT | SLEEP]))  # the prescale changes in sleep only
        self._device.write(bytes([PRE_SCALE, self._prescale]))
        self._device.write(bytes([MODE2, OUTDRV]))
        self.write(pulses_us)
        self._device.write(bytes([MODE1, AUTO_INCREMENT]))
        time.sleep(WAKE_S)
        if not self.is_set_up():
            raise OSError(errno.EIO, "the PCA9685 does not keep its settings")

    def is_set_up(self) -> bool:
        """Whether mode and frequency are as set; after a loss of power they are not, and the outputs are off."""
        (mode,) = self._device.read(MODE1, 1)
        (prescale,) = self._device.read(PRE_SCALE, 1)
        return (mode & (AUTO_INCREMENT | SLEEP)) == AUTO_INCREMENT and prescale == self._prescale

    def write(self, pulses_us: Mapping[int, float]) -> None:
        """Set the pulse [µs] of each channel, 0: none; on at count 0, off at the end of the pulse."""
        for channel, pulse_us in pulses_us.items():
            off = round(max(0.0, min(COUNTS - 1, pulse_us * self._counts_per_us))) or FULL_OFF
            self._device.write(bytes([LED0_ON_L + 4 * channel, 0, 0, off & 0xFF, off >> 8]))

    def pulse_us(self, channel: int) -> float | None:
        """The pulse [µs] that the chip sends on ``channel``, to half a count; None where it sends none."""
        if not self.is_set_up():
            return None
        on_low, on_high, off_low, off_high = self._device.read(LED0_ON_L + 4 * channel, 4)
        off = off_high << 8 | off_low
        return off / self._counts_per_us if 0 < off < COUNTS and not (on_low or on_high) else None

    def close(self) -> None:
        """Release the bus; the outputs go on."""
        self._device.close()
