"""Settings of the CAN actuator: the block ``can`` of ``config/actuator.yaml``, and the map of signals."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from trepid.config import InputError, Settings, resource
from trepid.types import Positive
from vehicle.actuators.can.checksums import Algorithm

ROAD_WHEEL, STEERING_WHEEL = "road_wheel_angle_rad", "steering_wheel_angle_rad"
OVERRIDE = "driver_override"
Commanded = Literal[
    "road_wheel_angle_rad",
    "steering_wheel_angle_rad",  # road-wheel angle · steering_ratio of the vehicle file
    "speed_mps",  # target speed
    "accel_mps2",  # negative brakes
    "drive_mps2",  # the positive part of the acceleration
    "brake_mps2",  # magnitude of its negative part
    "engaged",  # 1 from the first command based on a frame, 0 before it and in the safe state
]
Reported = Literal[
    "road_wheel_angle_rad",
    "steering_wheel_angle_rad",
    "speed_mps",
    "yaw_rate_radps",
    "driver_torque_nm",
    "driver_override",  # other than zero: the driver has the car
]


class CanSettings(Settings):
    """The block ``can`` of ``config/actuator.yaml``."""

    interface: str
    channel: str
    options: dict[str, Any] = Field(default_factory=dict)
    map: Path

    @property
    def map_file(self) -> Path:
        """The file of the map. Raises InputError when it does not exist."""
        path = resource(self.map)
        if not path.is_file():
            raise InputError(
                f"can: map: no such file {self.map}; its place is relative to the folder of the car"
            )
        return path


class Conversion(Settings):
    """One signal: signal = sign · scale · quantity + offset, in the units of the DBC."""

    signal: str
    invalid: frozenset[int] = (
        frozenset()
    )  # raw values that are no measurement, besides those that the DBC states
    scale: Positive = 1.0  # units of the signal per SI unit
    offset: float = 0.0  # in units of the signal
    sign: Literal[1, -1] = 1  # -1: the signal is positive to the right, or while braking


class CommandSignal(Conversion):
    """A signal that is sent."""

    quantity: Commanded


class ReportSignal(Conversion):
    """A signal that the car sends."""

    quantity: Reported


class Counter(Settings):
    """A signal that counts the messages."""

    signal: str
    modulo: Annotated[int, Field(ge=2)] | None = None  # None: as many values as the signal has


class Checksum(Settings):
    """A signal that holds a checksum of the message."""

    signal: str
    algorithm: Algorithm
    data_id: tuple[Annotated[int, Field(ge=0, le=255)], ...] = ()  # precedes the data in a CRC


class MessageMapping(Settings):
    """A message of the DBC."""

    message: str
    counter: Counter | None = None
    checksum: Checksum | None = None


class CommandMessage(MessageMapping):
    """A message that is sent; signals named nowhere are sent as zero."""

    period_s: Annotated[float, Field(ge=0.01)]  # the process writes at 100 Hz
    signals: Annotated[tuple[CommandSignal, ...], Field(min_length=1)]
    constants: dict[str, float] = Field(default_factory=dict)  # signal -> value in its units


class ReportMessage(MessageMapping):
    """A message that the car sends."""

    period_s: Positive  # at which the car sends it
    timeout_s: Positive  # the car is silent when the last valid one is older
    signals: Annotated[tuple[ReportSignal, ...], Field(min_length=1)]


class CanMap(Settings):
    """A map of signals, such as ``config/cars/shuttle/can/map.yaml``."""

    dbc: Path  # relative to the folder of the map
    safe_accel_mps2: Annotated[float, Field(ge=-4.0, le=0)] = (
        0.0  # at the end, after the limiter: UN R157 5.3
    )
    commands: Annotated[tuple[CommandMessage, ...], Field(min_length=1)]
    reports: Annotated[tuple[ReportMessage, ...], Field(min_length=1)]
