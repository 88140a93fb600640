"""A serial servo board on a pty with the simulated RC car behind its outputs, at the port of the block ``serial``.

Both protocols of :mod:`vehicle.actuators.rc.serial_board`. The watchdog of the board sets the throttle to neutral
after ``SILENCE_S`` without a valid command; the steering keeps its pulse.
"""

import os
import pty
import re
import tty
from contextlib import closing, suppress
from pathlib import Path

from sim_harness.counterparts.car import wire_settings
from sim_harness.counterparts.rc_car import RcCar
from trepid.processes.process import Process, Ticker, process
from vehicle.actuators.rc.serial_board import GET_ERRORS, SET_TARGET
from vehicle.actuators.rc.settings import SerialSettings

SILENCE_S = 0.25
SPEED_HZ = 50
SET = re.compile(rb"S(\d{1,2}) (\d{3,4})\r?")
SERIAL_PROTOCOL_ERROR, TIMEOUT_ERROR = 0x10, 0x20  # Maestro User's Guide, section 4.e


class ServoBoard:
    """Bytes in; pulses and answers out."""

    def __init__(self, protocol: str, throttle: int, neutral_us: float) -> None:
        self._protocol, self._throttle, self._neutral_us = protocol, throttle, neutral_us
        self.pulses_us: dict[int, float] = {}
        self.errors = 0
        self._rest = b""
        self._heard_s: float | None = None

    def feed(self, data: bytes, *, now_s: float) -> bytes:
        """Take ``data``; the answer of the board."""
        self._rest += data
        return self._ascii(now_s) if self._protocol == "ascii" else self._maestro(now_s)

    def watch(self, *, now_s: float) -> None:
        """The watchdog."""
        if self._heard_s is not None and now_s - self._heard_s > SILENCE_S:
            self.pulses_us[self._throttle] = self._neutral_us
            self.errors |= TIMEOUT_ERROR
            self._heard_s = None

    def _set(self, channel: int, pulse_us: float, now_s: float) -> None:
        self.pulses_us[channel] = pulse_us
        self._heard_s = now_s

    def _ascii(self, now_s: float) -> bytes:
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            found = SET.fullmatch(line)
            if found:
                self._set(int(found[1]), float(found[2]), now_s)
            else:
                self.errors |= SERIAL_PROTOCOL_ERROR
        return b""

    def _maestro(self, now_s: float) -> bytes:
        answer = b""
        while self._rest:
            if self._rest[0] == GET_ERRORS:
                answer += bytes([self.errors & 0x7F, self.errors >> 8])
                self.errors, self._rest = 0, self._rest[1:]
            elif self._rest[0] != SET_TARGET:
                self.errors |= SERIAL_PROTOCOL_ERROR
                self._rest = self._rest[1:]
            elif len(self._rest) < 4:
                break
            else:
                _, channel, low, high = self._rest[:4]
                self._set(channel, (high << 7 | low) / 4, now_s)
                self._rest = self._rest[4:]
        return answer


class Pty:
    """A pty whose far end appears at a path."""

    def __init__(self, path: str) -> None:
        self._path = Path(path)
        self._master, self._slave = pty.openpty()  # the open slave keeps the master alive between clients
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(self._slave))

    def read(self) -> bytes:
        """The bytes that wait."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Send ``data``; a client that does not read loses it."""
        with suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Close both ends."""
        os.close(self._master)
        os.close(self._slave)
        self._path.unlink(missing_ok=True)


def run(me: Process) -> None:
    """The board and the car, at the period of the car."""
    settings = wire_settings(me, SerialSettings, "serial")
    car = RcCar(me, settings)
    board = ServoBoard(settings.protocol, settings.throttle.channel, settings.throttle.neutral_us)
    with closing(Pty(settings.port)) as port:
        me.ready()
        ticker, speeds = Ticker(1 / car.period_s), Ticker(SPEED_HZ)
        while me.running():
            ticker.sleep()
            ticker.due()
            now_s = me.now_s()
            answer = board.feed(port.read(), now_s=now_s)
            board.watch(now_s=now_s)
            pulses_us = board.pulses_us
            car.step(
                pulses_us.get(settings.steering.channel),
                pulses_us.get(settings.throttle.channel),
                now_s=now_s,
            )
            if settings.protocol == "ascii" and speeds.due():
                answer += f"V{round(1000 * max(0.0, car.speed_mps))}\n".encode()
            if answer:
                port.write(answer)
            me.count_step()


if __name__ == "__main__":
    with process() as me:
        run(me)
