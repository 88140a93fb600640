"""An actuator: a car in this process that follows every command at once, for a drive without a car."""

from pydantic import PositiveFloat

from trepid.config import Settings as TrepidSettings
from trepid.messages import Command, VehicleState
from vehicle.actuators.actuator import Car


class IdealCar:
    """Speed is the integral of the commanded acceleration; the wheels stand at the commanded angle."""

    class Settings(TrepidSettings):
        """The block ``ideal_car`` of actuator.yaml."""

        max_speed_mps: PositiveFloat = 10.0

    def __init__(self, settings: Settings, car: Car) -> None:
        self._wheelbase_m, self._max_speed_mps = car.vehicle.wheelbase_m, settings.max_speed_mps
        self._speed_mps, self._angle_rad, self._accel_mps2 = 0.0, 0.0, 0.0
        self._t_s: float | None = None

    def read(self, *, now_s: float) -> VehicleState | None:
        """The state at ``now_s``."""
        self._advance(now_s)
        return VehicleState(
            t_s=now_s,
            speed_mps=self._speed_mps,
            road_wheel_angle_rad=self._angle_rad,
            yaw_rate_radps=self._speed_mps * self._angle_rad / self._wheelbase_m,
            driver_override=False,
        )

    def write(self, command: Command, *, now_s: float) -> None:
        """Follow ``command`` from now on."""
        self._advance(now_s)
        self._angle_rad, self._accel_mps2 = command.road_wheel_angle_rad, command.accel_mps2

    def values(self) -> tuple[tuple[str, str], ...]:
        """The speed, for the heartbeat."""
        return (("speed_mps", f"{self._speed_mps:.2f}"),)

    def close(self) -> None:
        """Stand still."""
        self._speed_mps = self._accel_mps2 = 0.0

    def _advance(self, now_s: float) -> None:
        if self._t_s is not None:
            speed_mps = self._speed_mps + self._accel_mps2 * (now_s - self._t_s)
            self._speed_mps = min(max(speed_mps, 0.0), self._max_speed_mps)
        self._t_s = now_s
