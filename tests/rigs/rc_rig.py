"""RC cars for tests: settings, and boards that speak the wire."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sim_harness.counterparts.pca9685 import Bus, Registers
from sim_harness.counterparts.servo_board import Pty, ServoBoard
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load, read
from trepid.messages import Command
from vehicle.actuators.actuator import Car
from vehicle.actuators.rc.settings import PcaSettings, SerialSettings

FILE = read(CONFIG_DIR / "actuator.yaml")
STEERING = dict(FILE["pca9685"]["steering"])
THROTTLE = dict(FILE["pca9685"]["throttle"])
STEERING_CHANNEL, THROTTLE_CHANNEL = STEERING["channel"], THROTTLE["channel"]
FLAT = """\
DRIVE_TRAIN_TYPE = "I2C_SERVO"
STEERING_CHANNEL = 3
STEERING_LEFT_PWM = 300
STEERING_RIGHT_PWM = 450
THROTTLE_CHANNEL = 5
THROTTLE_FORWARD_PWM = 450
THROTTLE_STOPPED_PWM = 370
"""
"""``myconfig.py`` of a donkeycar whose board has its numbers on the first level."""


class Time:
    """A clock that tests move."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def car(clock: Time) -> Car:
    """The car of an actuator without a bus; its wheels turn as far as the calibration says."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return Car(vehicle.model_copy(update={"max_road_wheel_angle_rad": STEERING["left_rad"]}), None, clock)


def pca(path: Path, **changed: Any) -> PcaSettings:
    """Settings of a chip on a socket."""
    return PcaSettings(
        **{
            **FILE["pca9685"],
            "bus": f"unix:{path}",
            "speed": "modelled",
            "yaw_rate": "modelled",
            "wait_s": 0,
            **changed,
        }
    )


def board(path: Path, **changed: Any) -> SerialSettings:
    """Settings of a servo board on a pty."""
    return SerialSettings(
        **{
            **FILE["serial"],
            "port": str(path),
            "speed": "sensor",
            "yaw_rate": "modelled",
            "wait_s": 0,
            **changed,
        }
    )


def command(angle_rad: float, accel_mps2: float) -> Command:
    return Command(t_s=1.0, road_wheel_angle_rad=angle_rad, speed_mps=2.0, accel_mps2=accel_mps2)


@contextmanager
def chip_on(path: Path, address: int = 0x40) -> Iterator[Registers]:
    """A PCA9685 that answers on a socket."""
    chip, stop = Registers(), threading.Event()
    bus = Bus(str(path), address, chip)

    def serve() -> None:
        while not stop.is_set():
            bus.serve(0.02)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield chip
    finally:
        stop.set()
        thread.join()
        bus.close()


class BoardOnPty:
    """A servo board that answers on request only."""

    def __init__(self, path: Path, protocol: str) -> None:
        self.port = Pty(str(path))
        self.board = ServoBoard(protocol, THROTTLE_CHANNEL, THROTTLE["neutral_us"])

    def turn(self, now_s: float, say: bytes = b"") -> None:
        """Read, watch, answer."""
        answer = self.board.feed(self.port.read(), now_s=now_s)
        self.board.watch(now_s=now_s)
        self.port.write(answer + say)
