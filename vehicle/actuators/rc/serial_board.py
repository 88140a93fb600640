"""Serial servo boards: ``ascii``, a protocol for a microcontroller of one's own, and ``maestro``, that of Pololu.

ascii: ``S<channel> <µs>`` and a line feed sets a pulse. The board sends ``V<mm/s>`` and a line feed with every
measurement of its speed sensor, where it has one. Without a command for 250 ms it sets the throttle to neutral.

maestro (Pololu Maestro User's Guide, section 5.e, compact protocol): 0x84, channel, two times 7 bits of the pulse
in quarters of a microsecond. 0xA1 asks for the errors since the last question. The board's "timeout" must be set.
"""

import errno
import termios
from collections.abc import Mapping
from typing import Any

from vehicle.actuators.rc.settings import SerialSettings

SET_TARGET, GET_ERRORS = 0x84, 0xA1
ASK_EVERY = 50  # writes, half a second
LONGEST_LINE = 64
WRITE_TIMEOUT_S = 0.05
RETRY_S = 0.5


def encode_pulse(protocol: str, channel: int, pulse_us: float) -> bytes:
    """The bytes that set one pulse."""
    if protocol == "ascii":
        return f"S{channel} {round(pulse_us)}\n".encode()
    quarters = round(4 * pulse_us)
    return bytes([SET_TARGET, channel, quarters & 0x7F, quarters >> 7 & 0x7F])


class SerialBoard:
    """One board on one port; a port that vanishes is opened again. All methods raise OSError."""

    def __init__(self, settings: SerialSettings) -> None:
        self._settings = settings
        self._port: Any = None
        self._received = b""
        self._speed_mps: float | None = None
        self._speed_s = 0.0
        self._retry_s = 0.0
        self._writes = 0
        self._unanswered = False
        self._errors = 0
        self._garbled = 0
        self._open()
        self.write({settings.throttle.channel: settings.throttle.neutral_us}, now_s=0.0)

    def write(self, pulses_us: Mapping[int, float], *, now_s: float) -> None:
        """Set the pulse [µs] of each channel."""
        if self._port is None and now_s >= self._retry_s:
            self._retry_s = now_s + RETRY_S
            self._open()
        data = b"".join(encode_pulse(self._settings.protocol, *item) for item in pulses_us.items())
        self._writes += 1
        asks = self._settings.protocol == "maestro" and self._writes % ASK_EVERY == 0
        if asks and self._unanswered:
            self._unanswered = False
            raise OSError(errno.ETIMEDOUT, f"{self._settings.port}: the board does not answer")
        self._unanswered = self._unanswered or asks
        self._attempt(lambda port: port.write(data + (bytes([GET_ERRORS]) if asks else b"")))

    def steering_us(self) -> None:
        """None: the board reports no pulse."""
        return

    def speed_mps(self, *, now_s: float) -> tuple[float, float] | None:
        """Newest speed [m/s] and its time; None when it is older than ``timeout_s`` or there is none."""
        self._received += self._attempt(lambda port: port.read(port.in_waiting))
        if self._settings.protocol == "maestro":
            self._take_errors()
        else:
            self._take_lines(now_s)
        if self._speed_mps is None or now_s - self._speed_s > self._settings.timeout_s:
            return None
        return self._speed_mps, self._speed_s

    def values(self) -> tuple[tuple[str, str], ...]:
        """Counts of lines that made no sense, and the errors of the board."""
        return (("garbled_lines", str(self._garbled)), ("board_errors", f"0x{self._errors:04x}"))

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _take_lines(self, now_s: float) -> None:
        *lines, self._received = self._received.split(b"\n")
        self._received = self._received[-LONGEST_LINE:]
        for line in lines:
            text = line.strip()
            if text[:1] == b"V" and text[1:].isdigit() and len(text) <= 6:
                self._speed_mps, self._speed_s = int(text[1:]) / 1000.0, now_s
            elif text:
                self._garbled += 1

    def _take_errors(self) -> None:
        while len(self._received) >= 2:
            self._errors |= self._received[0] | self._received[1] << 8
            self._received = self._received[2:]
            self._unanswered = False

    def _open(self) -> None:
        import serial

        try:
            self._port = serial.Serial(
                self._settings.port,
                self._settings.baud,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True,
            )
        except termios.error as error:  # unplugged again while it was opened
            raise OSError(*error.args) from error
        self._received = b""
        self._speed_mps = None

    def _attempt(self, act: Any) -> Any:
        if self._port is None:
            raise OSError(errno.ENODEV, f"{self._settings.port}: gone")
        try:
            return act(self._port)
        except OSError:
            self.close()
            raise
