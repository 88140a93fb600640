"""The sensors of the simulated car: noise, faults of the scenario, and the check of what they report."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from sim_harness.scenarios.faults import Sensors
from trepid.car.vehicle import Vehicle
from trepid.config import Settings
from trepid.messages import QUANTITIES, Command, VehicleState
from trepid.types import NonNegative
from vehicle.measurement.check import MeasurementCheck, absent
from vehicle.measurement.check import build as build_check

Carry = Callable[[VehicleState, Command | None, float], VehicleState | None]
"""The state that arrives, of the state that the car sends, the last command to it, and the time."""


class NoiseSettings(Settings):
    """The noise of the sensors in ``config/simulator.yaml``."""

    speed_noise_ratio: NonNegative
    road_wheel_angle_noise_rad: NonNegative
    yaw_rate_noise_radps: NonNegative


def _standard_normal(seed: int) -> Iterator[list[float]]:
    """Triples of independent standard normal numbers, drawn in blocks."""
    generator = np.random.default_rng((seed, 0))
    while True:
        yield from generator.standard_normal((1000, 3)).tolist()


class SimulatedSensors:
    """What the car reports, and what of it holds. Call ``measured`` for every state, then ``held``."""

    def __init__(
        self, noise: NoiseSettings, faults: Iterable[object], vehicle: Vehicle, *, seed: int, checked: bool
    ) -> None:
        """``checked``: the check stands here, and not at the near end of a wire."""
        self._settings, self._noise = noise, _standard_normal(seed)
        self._faulty = Sensors(faults)
        self._check: MeasurementCheck | None = build_check(vehicle) if checked else None
        self._carry: Carry | None = None
        self.watch: Callable[[VehicleState, float], None] | None = None
        """Called with every true state, before noise and faults, and the time of the run."""
        self.doubts: tuple[str, ...] = ()
        """Quantities of the newest state that do not hold, and why."""

    def put_wire(self, carry: Carry, check: MeasurementCheck) -> None:
        """Let ``carry`` take the states to the check, as the wire of a car does, and ``check`` be that check."""
        self._carry, self._check = carry, check

    def restart(self) -> None:
        """Restart the check of the measurements: the car was moved by hand."""
        if self._check is not None:
            self._check.restart()

    def measure(self, true: VehicleState, *, elapsed_s: float) -> VehicleState:
        """``true`` with white noise, that of the speed proportional to it, under the faults at ``elapsed_s``."""
        settings = self._settings
        speed, angle, rate = next(self._noise)
        assert true.speed_mps is not None
        assert true.road_wheel_angle_rad is not None
        assert true.yaw_rate_radps is not None
        noisy = replace(
            true,
            speed_mps=true.speed_mps * (1.0 + settings.speed_noise_ratio * speed),
            road_wheel_angle_rad=true.road_wheel_angle_rad + settings.road_wheel_angle_noise_rad * angle,
            yaw_rate_radps=true.yaw_rate_radps + settings.yaw_rate_noise_radps * rate,
        )
        if self.watch is not None:
            self.watch(true, elapsed_s)
        return self._faulty.step(noisy, elapsed_s=elapsed_s)

    def drop_doubted(
        self, state: VehicleState, applied: Command | None, *, driver: bool, now_s: float
    ) -> VehicleState:
        """``state`` without the measurements that do not hold; ``applied`` is the last command to the car."""
        if self._check is None:
            return state
        self._check.add_command(applied)
        arrived = state if self._carry is None else self._carry(state, applied, now_s)
        held, doubts = self._check.step(arrived, driver=driver, now_s=now_s)
        lacking = () if arrived is None else arrived.doubted
        self.doubts = (*(f"{QUANTITIES[name]}: not available" for name in lacking), *doubts)
        return held or absent(state.t_s)
