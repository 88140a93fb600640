"""The Ackermann actuator: ackermann_msgs/AckermannDriveStamped to a driver on the bus, and its state back.

The topics stand below ``trepid/<vehicle name>/``, in the wire format of ROS 2. The state is a
trepid_msgs/VehicleState, or a nav_msgs/Odometry, which holds speed and yaw rate.
"""

from dataclasses import replace
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from trepid.config import InputError, Settings, wrong_at
from trepid.messages import Command, Odometry, VehicleState
from trepid.topics import FIXED, Topic
from trepid.types import Positive
from vehicle.actuators.actuator import Car

RATE_HZ = 100
SOON_S = 1.0  # in which the goal of a brake would be reached
LEAST_MPS2 = 0.01  # that is sent: zero would mean as quickly as possible


class AckermannSettings(Settings):
    """The block ``ackermann`` of ``config/actuator.yaml``."""

    command_topic: str
    state_topic: str
    state: Literal["vehicle_state", "odometry"]
    wheel_angle: Literal["reported", "commanded"]
    timeout_s: Positive
    acceleration: Literal["magnitude", "signed"]
    safe_decel_mps2: Positive

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for field in ("command_topic", "state_topic"):
            if getattr(self, field) in FIXED:
                raise wrong_at((field,), f"{getattr(self, field)!r} is a topic of Trepid: choose another")
        if self.command_topic == self.state_topic:
            raise wrong_at(("state_topic",), "is the topic of the commands too")
        if self.state == "odometry" and self.wheel_angle == "reported":
            raise wrong_at(("wheel_angle",), "an odometry reports no wheel angle: choose commanded")
        return self


def command_topic(settings: AckermannSettings) -> Topic[Command]:
    """The topic of the limited commands."""
    return Topic(settings.command_topic, Command, RATE_HZ)


def state_topic(settings: AckermannSettings) -> Topic[Any]:
    """The topic of the reports of the driver."""
    kind: Any = Odometry if settings.state == "odometry" else VehicleState
    return Topic(settings.state_topic, kind, RATE_HZ)


class AckermannActuator:
    """Publishes every command and keeps the newest report."""

    Settings: ClassVar[type[AckermannSettings]] = AckermannSettings

    def __init__(self, settings: AckermannSettings, car: Car) -> None:
        """Raises InputError without a bus."""
        if car.bus is None:
            raise InputError("actuator 'ackermann' needs the bus of a drive")
        self._standstill_mps = car.vehicle.standstill_mps
        self._settings = settings
        self.computed = frozenset({"road_wheel_angle_rad"} if settings.wheel_angle == "commanded" else ())
        self._report = car.bus.latest(state_topic(settings))
        self._send = car.bus.publisher(command_topic(settings))
        self._last: Command | None = None
        self._speed_mps: float | None = None  # of the newest report

    def read(self, *, now_s: float) -> VehicleState | None:
        """The newest report; None when it arrived too long ago, or is malformed.

        With ``wheel_angle: commanded`` the angle is that of the last command. Nothing measures it, so the limiter
        cannot notice a driver by the wheel.
        """
        state = self._reported_state(now_s)
        self._speed_mps = None if state is None else state.speed_mps
        return state

    def _reported_state(self, now_s: float) -> VehicleState | None:
        report, received_s = self._report.refresh(), self._report.received_s
        if report is None or received_s is None or self._report.broken:
            return None
        if now_s - received_s > self._settings.timeout_s:
            return None
        state = report if isinstance(report, VehicleState) else state_of(report)
        if self._settings.wheel_angle == "commanded":
            return replace(state, road_wheel_angle_rad=self._commanded_angle_rad(state.speed_mps))
        return state

    def _commanded_angle_rad(self, speed_mps: float | None) -> float | None:
        """The angle of the last command; before it 0 for a car that stands, and None for one that rolls."""
        if self._last is not None:
            return self._last.road_wheel_angle_rad
        return 0.0 if speed_mps is not None and abs(speed_mps) <= self._standstill_mps else None

    def write(self, command: Command, *, now_s: float) -> None:
        """Publish ``command``."""
        self._last = command
        self._publish(command)

    def values(self) -> tuple[tuple[str, str], ...]:
        """No further values."""
        return ()

    def close(self) -> None:
        """Command a brake of ``safe_decel_mps2`` with the last wheel angle and no stamp, after a first command."""
        if self._last is not None:
            brake_mps2 = -self._settings.safe_decel_mps2
            self._publish(replace(self._last, t_s=None, speed_mps=0.0, accel_mps2=brake_mps2))

    def _publish(self, command: Command) -> None:
        """Publish ``command`` with its acceleration in the sense of the settings."""
        signed = self._settings.acceleration == "signed"
        self._send(command if signed else of_standard(command, self._speed_mps))


def of_standard(command: Command, speed_mps: float | None) -> Command:
    """``command`` in the sense of ackermann_msgs: its acceleration is the rate of change to its speed, up or down.

    Zero would mean as quickly as possible. The speed of a brake is below the present ``speed_mps``, and 0 where
    that is not known.
    """
    goal_mps = command.speed_mps
    if command.accel_mps2 < 0.0:
        soon_mps = 0.0 if speed_mps is None else speed_mps + SOON_S * command.accel_mps2
        goal_mps = max(0.0, min(goal_mps, soon_mps))
    return replace(command, speed_mps=goal_mps, accel_mps2=max(abs(command.accel_mps2), LEAST_MPS2))


def state_of(odometry: Odometry) -> VehicleState:
    """The state that ``odometry`` measures; the check of measurements takes out values that are not finite."""
    return VehicleState(
        t_s=odometry.t_s,
        speed_mps=odometry.speed_mps,
        road_wheel_angle_rad=None,
        yaw_rate_radps=odometry.yaw_rate_radps,
        driver_override=False,
    )
