"""The actuators ``pca9685`` and ``serial``: a command as two pulses; a state without what the car does not measure.

The road-wheel angle is that of the last pulse: no RC servo reports its own. At the start neutral is sent and the
steering left as it is, because after a restart the car may roll in a bend. A PCA9685 returns the pulse that it
holds; with another board the angle is not known until the car stands. A modelled speed is not known until a car
at neutral has come to rest. The driver override is not known, and
the yaw rate only where ``yaw_rate: modelled`` names the bicycle as its source. The calibration is read again when
``actuator.yaml`` changes, so that `trepid calibrate steering` acts on a running drive; a file with a fault leaves
the calibration as it is.
"""

from collections.abc import Mapping
from typing import ClassVar, Protocol

from controller.limiter import Limits
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, place, read, texts
from trepid.messages import Command, VehicleState
from vehicle.actuators.actuator import Car
from vehicle.actuators.rc.chip import CHECK_EVERY, GuardedChip, open_within
from vehicle.actuators.rc.pulses import REST_LAGS, Silence, SpeedIntegrator, Steering, Throttle, YawModel
from vehicle.actuators.rc.serial_board import SerialBoard
from vehicle.actuators.rc.settings import PcaSettings, RcSettings, SerialSettings, SpeedSource
from vehicle.actuators.table import FILE, configured_actuator

BRAKE_FROM_MPS2 = 1.5  # a harder brake than that of a neutral throttle
BRAKE_ABOVE_MPS = 0.2  # below it the brake pulse may start the reverse


class Board(Protocol):
    """What takes pulses. All methods raise OSError."""

    def write(self, pulses_us: Mapping[int, float], *, now_s: float) -> None:
        """Set the pulse [µs] of each channel."""
        ...

    def steering_us(self) -> float | None:
        """The steering pulse [µs] that the board held when it was opened; None: not known."""
        ...

    def speed_mps(self, *, now_s: float) -> tuple[float, float] | None:
        """Measured speed [m/s] and its time; None without one."""
        ...

    def values(self) -> tuple[tuple[str, str], ...]:
        """Values for the heartbeat."""
        ...

    def close(self) -> None:
        """Release the board."""
        ...


class PulseCalibration:
    """The pulses of the settings file, read again when it changes."""

    def __init__(self, name: str, settings: RcSettings, vehicle: Vehicle) -> None:
        self._name, self._vehicle = name, vehicle
        self.steering, self.throttle = settings.steering, settings.throttle
        self.refused = ""
        """The fault of the newest file; "" without one."""
        self._written = texts(FILE)

    def refresh(self) -> None:
        """Take the pulses of a changed file over."""
        try:
            written = texts(FILE)
            if written == self._written:
                return
            self._written = written
            name, settings = configured_actuator()
            if name != self._name or not isinstance(settings, RcSettings):
                raise InputError(f"actuator.yaml names {name!r} now")
            if _fixed_values(settings.steering, settings.throttle) != _fixed_values(
                self.steering, self.throttle
            ):
                raise InputError("other channels or another neutral_us count from the next start on")
            require_reach(name, settings.steering, self._vehicle)
        except InputError as error:
            self.refused = str(error)
            return
        self.steering, self.throttle, self.refused = settings.steering, settings.throttle, ""


def _fixed_values(steering: Steering, throttle: Throttle) -> tuple[int, int, float]:
    """What must not change while driving: the guard and the speed controller have learned it at their start."""
    return steering.channel, throttle.channel, throttle.neutral_us


class RcActuator:
    """A board, its calibration, and the speed that the car has or should have."""

    def __init__(self, name: str, settings: RcSettings, car: Car) -> None:
        """Open the board. Raises InputError when it does not answer, and for settings that cannot drive ``car``."""
        _require_sources(name, settings)
        require_reach(name, settings.steering, car.vehicle)
        self._board = open_board(settings)
        self._source = settings.speed
        modelled = {"speed_mps"} if settings.speed is SpeedSource.MODELLED else set()
        self.computed = frozenset({"road_wheel_angle_rad", "yaw_rate_radps"} | modelled)
        self._calibration = PulseCalibration(name, settings, car.vehicle)
        self._motion = SpeedIntegrator(settings.speed_lag_s)
        held_us = self._board.steering_us()
        self._angle_rad = None if held_us is None else settings.steering.angle_rad(held_us)
        self._models_yaw = settings.yaw_rate == "modelled"
        self._yaw = YawModel(car.vehicle, self._angle_rad, now_s=car.now_s())
        self._standstill_mps = car.vehicle.standstill_mps
        self._rests_s = car.now_s() + REST_LAGS * settings.speed_lag_s
        self._silence = Silence(settings.neutral_after_s, self._motion)
        self._writes = 0
        self._measured: tuple[float, float] | None = None

    def read(self, *, now_s: float) -> VehicleState | None:
        """Speed as measured or as modelled, and the angle of the last pulse; None while the sensor is silent."""
        self._measured = None
        self._silence.check(now_s=now_s)
        self._measured = self._board.speed_mps(now_s=now_s)
        speed_mps, t_s = None, now_s
        if self._source is SpeedSource.MODELLED:
            speed_mps = self._motion.modelled_mps if now_s >= self._rests_s else None
        elif self._measured is not None:
            speed_mps, t_s = self._measured
        else:
            return None
        if self._angle_rad is None and speed_mps is not None and speed_mps <= self._standstill_mps:
            self._angle_rad = 0.0
        yaw_rate_radps = self._yaw.step(self._angle_rad, speed_mps, now_s=now_s)
        return VehicleState(
            t_s=t_s,
            speed_mps=speed_mps,
            road_wheel_angle_rad=self._angle_rad,
            yaw_rate_radps=yaw_rate_radps if self._models_yaw else None,
            driver_override=False,
        )

    def write(self, command: Command, *, now_s: float) -> None:
        """Set the pulses for ``command``: its angle, and the speed that its acceleration leads to."""
        self._silence.check(now_s=now_s)
        self._writes += 1
        if self._writes % CHECK_EVERY == 0:
            self._calibration.refresh()
        steering, throttle = self._calibration.steering, self._calibration.throttle
        measured_mps = None if self._measured is None else self._measured[0]
        brakes = command.accel_mps2 <= -BRAKE_FROM_MPS2
        # A demand near the measured speed drives the car: a hard brake, and a sensor that is silent, leave neutral.
        neutral = self._source is SpeedSource.SENSOR and (brakes or measured_mps is None)
        most_mps = 0.0 if neutral else throttle.most_mps
        throttle_us = throttle.pulse_us(
            self._motion.step(command.accel_mps2, most_mps, measured_mps, now_s=now_s)
        )
        if throttle.brake_us is not None and brakes and (measured_mps or 0.0) > BRAKE_ABOVE_MPS:
            throttle_us = throttle.brake_us
        self._angle_rad = steering.reachable_angle_rad(command.road_wheel_angle_rad)
        self._board.write(
            {steering.channel: steering.pulse_us(self._angle_rad), throttle.channel: throttle_us}, now_s=now_s
        )
        self._silence.end(now_s=now_s)

    def values(self) -> tuple[tuple[str, str], ...]:
        """Speed source, values of the board, and the fault of a refused calibration."""
        refused = (("calibration", self._calibration.refused),) if self._calibration.refused else ()
        return (("speed_source", str(self._source)), *refused, *self._board.values())

    def close(self) -> None:
        """Throttle neutral, the wheels as they stand; release the board."""
        throttle = self._calibration.throttle
        try:
            self._board.write({throttle.channel: throttle.neutral_us}, now_s=0.0)
        finally:
            self._board.close()


class PcaBoard(GuardedChip):
    """A PCA9685 with servo and speed controller."""

    def __init__(self, settings: PcaSettings) -> None:
        self._steering, self._throttle = settings.steering, settings.throttle
        self._held_us: float | None = None
        super().__init__(settings, settings.rest_us, {self._throttle.channel: self._throttle.neutral_us})

    def begin(self) -> None:
        """Set neutral, and the centre where the chip holds no pulse within the hard ends."""
        held_us = self.chip.pulse_us(self._steering.channel)
        if held_us is None or abs(held_us - self._steering.within(held_us)) > self.chip.count_us:
            super().begin()
            return
        self.chip.write({self._throttle.channel: self._throttle.neutral_us})
        self._held_us = held_us

    def steering_us(self) -> float:
        """The pulse of the straight wheels, or the one that the chip has held since a process before this one."""
        return self._steering.centre_us if self._held_us is None else self._held_us

    def speed_mps(self, *, now_s: float) -> None:
        """None: the chip measures nothing."""
        return


def open_board(settings: RcSettings) -> Board:
    """The board of ``settings``, which may appear within ``wait_s``, at neutral, as speed controllers expect.

    Raises InputError with the remedy.
    """

    def open_one() -> Board:
        if isinstance(settings, PcaSettings):
            return PcaBoard(settings)
        assert isinstance(settings, SerialSettings)
        return SerialBoard(settings)

    try:
        return open_within(settings.wait_s, open_one, *_place_and_remedy(settings))
    except ImportError as error:
        raise InputError(f"serial: needs the package {error.name}: pip install 'trepid[rc]'") from error


def _place_and_remedy(settings: RcSettings) -> tuple[str, str]:
    if isinstance(settings, PcaSettings):
        return settings.place_and_remedy("pca9685")
    assert isinstance(settings, SerialSettings)
    remedy = "`ls /dev/serial/by-id` lists the boards; your user must be in the group `dialout`"
    return f"serial: {settings.port}", remedy


class PcaActuator(RcActuator):
    """A PCA9685 on an I2C bus."""

    Settings: ClassVar[type[PcaSettings]] = PcaSettings

    def __init__(self, settings: PcaSettings, car: Car) -> None:
        super().__init__("pca9685", settings, car)


class SerialActuator(RcActuator):
    """A servo board on a serial port."""

    Settings: ClassVar[type[SerialSettings]] = SerialSettings

    def __init__(self, settings: SerialSettings, car: Car) -> None:
        super().__init__("serial", settings, car)


def require_reach(name: str, steering: Steering, vehicle: Vehicle) -> None:
    """Raise InputError where the wheels stay so far behind a demand that the limiter takes it for a driver."""
    most_rad = vehicle.max_road_wheel_angle_rad
    hold_rad = load(CONFIG_DIR / "limiter.yaml", Limits).override.angle_rad
    reach_rad, side = min((steering.left_rad, "left_rad"), (steering.right_rad, "right_rad"))
    if reach_rad + hold_rad < most_rad:
        raise InputError(
            f"{place(read(FILE), [name, 'steering', side], FILE)}: {name}.steering.{side}: {reach_rad:g} rad is "
            f"less than max_road_wheel_angle_rad of vehicle.yaml, {most_rad:g}, by more than override.angle_rad "
            f"of limiter.yaml, {hold_rad:g}: the limiter would take the end of the steering for a driver who "
            f"holds the wheels; set max_road_wheel_angle_rad to {reach_rad:g}"
        )


def _require_sources(name: str, settings: RcSettings) -> None:
    if settings.speed is SpeedSource.NONE:
        raise InputError(
            f"actuator.yaml: {name}.speed: none: the limiter drives no car of unknown speed; choose `modelled` "
            "(the throttle table) or `sensor`: docs/rc_boards.md"
        )
    if settings.yaw_rate == "none":
        raise InputError(
            f"actuator.yaml: {name}.yaw_rate: none: the supervisor drives no car of unknown yaw rate; choose "
            "`modelled` (the bicycle of vehicle.yaml): docs/rc_boards.md"
        )
