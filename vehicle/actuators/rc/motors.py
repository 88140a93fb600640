"""The actuator ``motor_hat``: two wheels, each with a DC motor behind an H-bridge, on a PCA9685.

These are the boards of Duckiebots and JetBots (Adafruit's DC Motor HAT and its kin): three channels a motor, one
for the duty of its drive and two for its direction. With the distance b between the wheels and the wheelbase L of
``vehicle.yaml``, here only the length by which an angle stands for a curvature, a differential drive has

    v_left = v·(1 - κ·b/2)    v_right = v·(1 + κ·b/2)    κ = tan δ/L

(Siegwart, Nourbakhsh, Scaramuzza, Introduction to Autonomous Mobile Robots, 2011, 3.2.3). No wheel turns backwards:
|κ| ≤ 2/b, which ``vehicle.yaml`` must keep, so that the limiter knows it. The speed gives way to the curvature:
v·(1 + |κ|·b/2) is at most the fastest speed of a wheel.

Nothing measures: speed, angle and yaw rate are those of the last duties. At a duty of 0 the bridges brake.
"""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from trepid.car.vehicle import Vehicle
from trepid.config import InputError, Settings, place, read, wrong_at
from trepid.messages import Command, VehicleState
from trepid.types import NonNegative, Positive, Share
from vehicle.actuators.actuator import Car
from vehicle.actuators.rc.chip import GuardedChip, open_within
from vehicle.actuators.rc.pulses import REST_LAGS, Silence, SpeedIntegrator, YawModel, interpolate
from vehicle.actuators.rc.settings import ChipSettings
from vehicle.actuators.table import FILE

NAME = "motor_hat"
Channel = Annotated[int, Field(ge=0, le=15)]
Speed = Annotated[float, Field(ge=0, le=40)]


class Motor(Settings):
    """One wheel: its channels, and the duty of each measured speed."""

    duty: Channel
    ahead: Channel  # high while the wheel drives ahead
    back: Channel  # low, likewise
    speeds: Annotated[tuple[tuple[Speed, Share], ...], Field(min_length=1)]
    """(speed of the wheel on the floor [m/s], duty), slowest first. The speed 0 may stand for the dead band."""

    @model_validator(mode="after")
    def _rises(self) -> Self:
        before = (-1.0, 0.0)
        for index, (speed_mps, duty) in enumerate(self.speeds):
            if speed_mps <= before[0] or duty <= before[1]:
                raise wrong_at(("speeds", index), "speeds and their duties must rise, from above 0")
            before = speed_mps, duty
        if self.most_mps <= 0.0:
            raise wrong_at(("speeds",), "needs at least one speed above 0")
        return self

    @property
    def most_mps(self) -> float:
        """The fastest speed of the table."""
        return self.speeds[-1][0]

    def duty_at(self, speed_mps: float) -> float:
        """The duty for a speed of the wheel: exactly 0 for 0, at most that of the fastest speed."""
        if speed_mps <= 0.0:
            return 0.0
        first = () if self.speeds[0][0] == 0.0 else ((0.0, 0.0),)
        return interpolate((*first, *self.speeds), speed_mps)


class MotorSettings(ChipSettings):
    """The block ``motor_hat``."""

    wait_s: Annotated[float, Field(ge=0, le=60)]  # a board may appear so long after the start
    state: Literal["none", "modelled"]  # modelled: speed and yaw rate by the table and the two wheels
    speed_lag_s: NonNegative  # time constant from duty to speed
    apart_m: Positive  # between the middles of the two wheels
    left: Motor
    right: Motor

    @model_validator(mode="after")
    def _own_channels(self) -> Self:
        taken: set[int] = set()
        for side in ("left", "right"):
            for name in ("duty", "ahead", "back"):
                channel = getattr(getattr(self, side), name)
                if channel in taken:
                    raise wrong_at((side, name), f"channel {channel} is taken already")
                taken.add(channel)
        return self

    @property
    def most_mps(self) -> float:
        """The speed that both wheels reach."""
        return min(self.left.most_mps, self.right.most_mps)

    def wheel_speeds(self, speed_mps: float, curvature_1pm: float) -> tuple[float, float]:
        """Speeds [m/s] of the left and the right wheel on an arc."""
        half = curvature_1pm * self.apart_m / 2
        return speed_mps * (1 - half), speed_mps * (1 + half)


class MotorActuator:
    """Wheel speeds for every command, and the state that they should give."""

    Settings: ClassVar[type[MotorSettings]] = MotorSettings
    computed = frozenset({"speed_mps", "road_wheel_angle_rad", "yaw_rate_radps"})

    def __init__(self, settings: MotorSettings, car: Car) -> None:
        """Open the board. Raises InputError when it does not answer, and for settings that cannot drive ``car``."""
        if settings.state == "none":
            raise InputError(
                f"actuator.yaml: {NAME}.state: none: the limiter drives no car of unknown speed; choose `modelled` "
                "(the tables of the two wheels): docs/rc.md"
            )
        require_inner_wheel(settings, car.vehicle)
        self._settings, self._vehicle = settings, car.vehicle
        duties = {settings.left.duty: 0.0, settings.right.duty: 0.0}
        rest_us = {**duties, settings.left.back: 0.0, settings.right.back: 0.0}
        rest_us |= {settings.left.ahead: math.inf, settings.right.ahead: math.inf}  # all of a period
        self._board = open_within(
            settings.wait_s,
            lambda: GuardedChip(settings, rest_us, duties),
            *settings.place_and_remedy(NAME),
        )
        self._period_us = self._board.chip.period_us
        self._motion = SpeedIntegrator(settings.speed_lag_s)
        self._silence = Silence(settings.guard_s, self._motion)
        self._angle_rad = 0.0
        self._yaw = YawModel(car.vehicle, self._angle_rad, now_s=car.now_s())
        self._rests_s = car.now_s() + REST_LAGS * settings.speed_lag_s

    def read(self, *, now_s: float) -> VehicleState:
        """The state by the last duties; before the wheels of a restarted drive rest, without a speed."""
        self._silence.check(now_s=now_s)
        speed_mps = self._motion.modelled_mps if now_s >= self._rests_s else None
        return VehicleState(
            t_s=now_s,
            speed_mps=speed_mps,
            road_wheel_angle_rad=self._angle_rad,
            yaw_rate_radps=self._yaw.step(self._angle_rad, speed_mps, now_s=now_s),
            driver_override=False,
        )

    def write(self, command: Command, *, now_s: float) -> None:
        """Set the duties for ``command``: its angle, and the speed that its acceleration leads to."""
        self._silence.check(now_s=now_s)
        most_rad = self._vehicle.max_road_wheel_angle_rad
        self._angle_rad = max(-most_rad, min(most_rad, command.road_wheel_angle_rad))
        curvature_1pm = math.tan(self._angle_rad) / self._vehicle.wheelbase_m
        most_mps = self._settings.most_mps / (1 + abs(curvature_1pm) * self._settings.apart_m / 2)
        speed_mps = self._motion.step(command.accel_mps2, most_mps, None, now_s=now_s)
        wheels_mps = self._settings.wheel_speeds(speed_mps, curvature_1pm)
        self._board.write(self._pulses_us(wheels_mps), now_s=now_s)
        self._silence.end(now_s=now_s)

    def values(self) -> tuple[tuple[str, str], ...]:
        """Source of the speed, and losses of power."""
        return (("speed_source", self._settings.state), *self._board.values())

    def close(self) -> None:
        """Take the drive away, which brakes the motors; release the board."""
        try:
            self._board.write(self._pulses_us((0.0, 0.0)), now_s=0.0)
        finally:
            self._board.close()

    def _pulses_us(self, wheels_mps: tuple[float, float]) -> Mapping[int, float]:
        motors = self._settings.left, self._settings.right
        return {
            motor.duty: motor.duty_at(speed_mps) * self._period_us
            for motor, speed_mps in zip(motors, wheels_mps, strict=True)
        }


def require_inner_wheel(settings: MotorSettings, vehicle: Vehicle) -> None:
    """Raise InputError where ``vehicle`` may turn more tightly than about a standing wheel."""
    most_rad = math.atan(2 * vehicle.wheelbase_m / settings.apart_m)
    if vehicle.max_road_wheel_angle_rad > most_rad:
        raise InputError(
            f"{place(read(FILE), [NAME, 'apart_m'], FILE)}: {NAME}.apart_m: at {settings.apart_m:g} m between the "
            f"wheels the inner one stands at {most_rad:.2f} rad, and max_road_wheel_angle_rad of vehicle.yaml is "
            f"{vehicle.max_road_wheel_angle_rad:g}: at most {math.floor(100 * most_rad) / 100:g}"
        )
