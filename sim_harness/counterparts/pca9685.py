"""A PCA9685 with the simulated RC car behind its outputs, on the socket of the block ``pca9685``.

The registers follow the data sheet (NXP, rev. 4): PRE_SCALE changes in sleep only, MODE1.AI moves the register on
within a transfer, sleep and full-off stop an output. The chip has no watchdog: it repeats the last pulse for ever.
"""

import selectors
import socket
from contextlib import closing
from pathlib import Path

from sim_harness.counterparts.car import wire_settings
from sim_harness.counterparts.rc_car import RcCar
from trepid.config import InputError
from trepid.processes.process import Process, Ticker, process
from vehicle.actuators.rc.i2c import READ, UNIX, WRITE
from vehicle.actuators.rc.pca9685 import AUTO_INCREMENT, COUNTS, LED0_ON_L, MODE1, PRE_SCALE, SLEEP
from vehicle.actuators.rc.settings import PcaSettings

POWER_ON = {MODE1: 0x11, 0x01: 0x04, PRE_SCALE: 0x1E}  # data sheet, tables 5, 6 and 9
FULL = 0x10  # bit 4 of ON_H and OFF_H


class Registers:
    """The 256 registers, and the pulses that they mean."""

    def __init__(self, oscillator_hz: float = 25e6) -> None:
        self._oscillator_hz = oscillator_hz
        self.power_on()

    def power_on(self) -> None:
        """The state after power-on: asleep, all outputs fully off."""
        self._bytes = bytearray(256)
        for channel in range(16):
            self._bytes[LED0_ON_L + 4 * channel + 3] = FULL
        for register, value in POWER_ON.items():
            self._bytes[register] = value

    def write(self, data: bytes) -> None:
        """One transfer: the register, then its bytes."""
        register = data[0]
        for value in data[1:]:
            if register == PRE_SCALE:
                if self._bytes[MODE1] & SLEEP:
                    self._bytes[register] = max(3, value)
            else:
                self._bytes[register] = value
            register = self._next(register)

    def read(self, register: int, count: int) -> bytes:
        """``count`` bytes from ``register`` on."""
        found = bytearray()
        for _ in range(count):
            found.append(self._bytes[register])
            register = self._next(register)
        return bytes(found)

    def _next(self, register: int) -> int:
        return (register + 1) % 256 if self._bytes[MODE1] & AUTO_INCREMENT else register

    @property
    def frequency_hz(self) -> float:
        """Frequency of the pulses."""
        return self._oscillator_hz / (COUNTS * (self._bytes[PRE_SCALE] + 1))

    def pulse_us(self, channel: int) -> float | None:
        """Length of the pulse [µs] of ``channel``; None while it has none."""
        on_low, on_high, off_low, off_high = self._bytes[
            LED0_ON_L + 4 * channel : LED0_ON_L + 4 * channel + 4
        ]
        if self._bytes[MODE1] & SLEEP or (off_high | on_high) & FULL:
            return None
        counts = ((off_high & 0x0F) << 8 | off_low) - ((on_high & 0x0F) << 8 | on_low)
        return counts % COUNTS / COUNTS / self.frequency_hz * 1e6


class Bus:
    """The socket end of an I2C bus with one chip."""

    def __init__(self, path: str, address: int, chip: Registers) -> None:
        self._path, self._address, self._chip = Path(path), address, chip
        self._path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.bind(path)
        self._socket.listen()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)

    def serve(self, timeout_s: float) -> bool:
        """Answer the transfers that wait, or the first within ``timeout_s``; False without any."""
        ready = self._selector.select(timeout_s)
        for key, _ in ready:
            if key.fileobj is self._socket:
                self._selector.register(self._socket.accept()[0], selectors.EVENT_READ)
            else:
                assert isinstance(key.fileobj, socket.socket)
                self._answer(key.fileobj)
        return bool(ready)

    def _answer(self, client: socket.socket) -> None:
        try:
            packet = client.recv(256)
            if packet:
                client.send(self._transfer(packet))
                return
        except OSError:
            pass  # the client has ended during the transfer
        self._selector.unregister(client)
        client.close()

    def _transfer(self, packet: bytes) -> bytes:
        kind, address, *data = packet
        if address != self._address or not data or kind not in (READ, WRITE):
            return b"\1"
        if kind == WRITE:
            self._chip.write(bytes(data))
            return b"\0"
        return b"\0" + self._chip.read(data[0], data[1])

    def close(self) -> None:
        """Close all sockets."""
        for key in list(self._selector.get_map().values()):
            assert isinstance(key.fileobj, socket.socket)
            key.fileobj.close()
        self._selector.close()
        self._path.unlink(missing_ok=True)


def run(me: Process) -> None:
    """The chip answers at once; the car moves at its period."""
    settings = wire_settings(me, PcaSettings, "pca9685")
    if not settings.bus.startswith(UNIX):
        raise InputError(
            f"process {me.name} simulates a PCA9685 on a socket; set pca9685.bus: {UNIX}PATH in actuator.yaml"
        )
    chip, car = Registers(settings.oscillator_hz), RcCar(me, settings)
    steering, throttle = settings.steering.channel, settings.throttle.channel
    with closing(Bus(settings.bus.removeprefix(UNIX), settings.address, chip)) as bus:
        me.ready()
        ticker = Ticker(1 / car.period_s)
        while me.running():
            bus.serve(ticker.remaining_s())
            if ticker.due():
                car.step(chip.pulse_us(steering), chip.pulse_us(throttle), now_s=me.now_s())
                me.count_step()


if __name__ == "__main__":
    with process() as me:
        run(me)
