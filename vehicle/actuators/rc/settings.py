"""Settings of the actuators of RC cars: the blocks ``pca9685`` and ``serial`` of ``config/actuator.yaml``."""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from trepid.config import Settings, wrong_at
from trepid.types import NonNegative, Positive
from vehicle.actuators.rc.pulses import Steering, Throttle

WRITES_HZ = 100.0  # of vehicle.actuators.node
PULSE_BYTES = {"ascii": len("S10 1500\n"), "maestro": 4}
BITS_A_BYTE = 10  # with start and stop bit
SPARE = 1.5  # of the bytes, so that a pulse never waits behind older ones
BOARD_SILENCE_S = 0.25  # of the watchdog of a serial board: docs/rc_boards.md


class SpeedSource(StrEnum):
    """Where the speed of the car comes from."""

    NONE = "none"  # nowhere: it is not known, and Trepid does not drive
    MODELLED = "modelled"  # the throttle table: the speed that the pulse should give
    SENSOR = "sensor"  # the board measures it


class RcSettings(Settings):
    """What all RC cars have."""

    wait_s: Annotated[float, Field(ge=0, le=60)]  # a board may appear so long after the start
    speed: SpeedSource
    yaw_rate: Literal["none", "modelled"]  # modelled: bicycle at the speed and the angle of the last pulses
    speed_lag_s: NonNegative  # time constant from pulse to speed, of `modelled`
    steering: Steering
    throttle: Throttle

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.steering.channel == self.throttle.channel:
            raise wrong_at(("throttle", "channel"), "is the channel of the steering too")
        if self.speed is SpeedSource.SENSOR and not self._measures():
            raise wrong_at(("speed",), "this board measures no speed: choose modelled")
        if self.throttle.brake_us is not None and self.speed is not SpeedSource.SENSOR:
            raise wrong_at(
                ("throttle", "brake_us"),
                "needs speed: sensor, because at standstill most speed controllers take it for reverse",
            )
        return self

    @property
    def rest_us(self) -> dict[int, float]:
        """The pulse [µs] of each channel for straight wheels without drive."""
        return {
            self.steering.channel: self.steering.centre_us,
            self.throttle.channel: self.throttle.neutral_us,
        }

    @property
    def neutral_after_s(self) -> float:
        """The throttle is neutral when no pulse has been sent for this time."""
        return BOARD_SILENCE_S

    def _measures(self) -> bool:
        return False


class ChipSettings(Settings):
    """A PCA9685 and its guard."""

    bus: str  # /dev/i2c-N, or unix:PATH
    address: Annotated[int, Field(ge=0x03, le=0x77)]
    frequency_hz: Annotated[float, Field(ge=40, le=1526)]  # the chip's own range
    oscillator_hz: Annotated[float, Field(ge=20e6, le=32e6)]
    guard_s: Annotated[float, Field(gt=0.03, le=1.0)]

    def place_and_remedy(self, name: str) -> tuple[str, str]:
        """Where the chip of the block ``name`` is sought, and what to do where it does not answer."""
        remedy = "`i2cdetect -y N` lists the devices; your user must be in the group `i2c`"
        return f"{name}: {self.bus}, address 0x{self.address:02x}", remedy


class PcaSettings(ChipSettings, RcSettings):
    """The block ``pca9685``."""

    frequency_hz: Annotated[float, Field(ge=40, le=400)]  # that servos take

    @property
    def neutral_after_s(self) -> float:
        """That of the guard."""
        return self.guard_s

    @model_validator(mode="after")
    def _channels(self) -> Self:
        for name, part in (("steering", self.steering), ("throttle", self.throttle)):
            if part.channel > 15:
                raise wrong_at((name, "channel"), "a PCA9685 has the channels 0 to 15")
            if part.most_us * 1e-6 * self.frequency_hz >= 1.0:
                raise wrong_at((name, "most_us"), f"is longer than a period of {self.frequency_hz:g} Hz")
        return self


class SerialSettings(RcSettings):
    """The block ``serial``."""

    port: str
    baud: Annotated[int, Field(ge=1200, le=2_000_000)]
    protocol: Literal["ascii", "maestro"]
    timeout_s: Positive  # an older speed of the board counts as unknown

    @model_validator(mode="after")
    def _fast_enough(self) -> Self:
        least_baud = SPARE * BITS_A_BYTE * WRITES_HZ * 2 * PULSE_BYTES[self.protocol]
        if self.baud < least_baud:
            raise wrong_at(
                ("baud",),
                f"is too slow: two pulses at {WRITES_HZ:g} Hz with {self.protocol} need at least {least_baud:g}",
            )
        return self

    def _measures(self) -> bool:
        return self.protocol == "ascii"
