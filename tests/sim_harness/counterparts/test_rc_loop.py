"""Commands through limiter, RC actuator, board and simulated car, in one process and in given time."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from rc_rig import STEERING_CHANNEL, THROTTLE_CHANNEL, BoardOnPty, Time, board, car, chip_on, command, pca

from controller.limiter import build as build_limiter
from sim_harness.counterparts.rc_car import motion_of
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import Scenario
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from vehicle.actuators.node import ActuatorStep
from vehicle.actuators.rc.actuator import PcaActuator, RcActuator, SerialActuator
from vehicle.measurement.check import build as build_check

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
STARTING = 170  # steps until a modelled speed is known, and a few more
SCENARIO = Scenario.model_validate(dict(description="", tags=["nominal"], road="straight", duration_s=60.0))


class Loop:
    """Near end: limiter and actuator. Far end: board and car."""

    def __init__(self, settings, actuator: RcActuator, clock: Time, pulses, reports) -> None:
        self.settings, self.actuator, self.clock = settings, actuator, clock
        self._pulses, self._reports = pulses, reports
        self.node = ActuatorStep(build_limiter(VEHICLE), build_check(VEHICLE))
        self.car = SimulatedVehicle(SCENARIO, SCENARIO.build_road(), VEHICLE, None, load_simulator(), seed=0)
        self.speed_mps = 0.0

    def step(self, demand) -> None:
        """10 ms with ``demand``; None: the controller is silent."""
        self.clock.now_s += 0.01
        now_s = self.clock.now_s
        state = self.actuator.read(now_s=now_s)
        order = None if demand is None else replace(command(*demand), t_s=now_s)
        applied = self.node.step(order, now_s if order else None, state, now_s=now_s)
        if applied.command is not None:
            self.actuator.write(applied.command, now_s=now_s)
        acting = motion_of(
            self.settings, self._pulses(now_s), self.speed_mps, VEHICLE.max_accel_mps2, now_s=now_s
        )
        measured, self.truth = self.car.step(acting, now_s, now_s=now_s)
        self.speed_mps = measured.speed_mps
        self._reports(self.speed_mps)

    def steps(self, count: int, *demand: float) -> None:
        for _ in range(count):
            self.step(demand or None)


@pytest.fixture(params=["pca9685", "ascii", "maestro"])
def loop(request, tmp_path) -> Iterator[Loop]:
    """A loop through each wire."""
    clock = Time()
    if request.param == "pca9685":
        with chip_on(tmp_path / "i2c") as chip:
            settings = pca(tmp_path / "i2c")
            actuator = PcaActuator(settings, car(clock))
            yield Loop(
                settings,
                actuator,
                clock,
                lambda now_s: (chip.pulse_us(STEERING_CHANNEL), chip.pulse_us(THROTTLE_CHANNEL)),
                lambda speed_mps: None,
            )
            actuator.close()
        return
    there = BoardOnPty(tmp_path / "tty", request.param)
    speed = "sensor" if request.param == "ascii" else "modelled"
    settings = board(tmp_path / "tty", protocol=request.param, speed=speed)

    def pulses(now_s: float) -> tuple[float | None, float | None]:
        there.turn(now_s)
        return there.board.pulses_us.get(STEERING_CHANNEL), there.board.pulses_us.get(THROTTLE_CHANNEL)

    def reports(speed_mps: float) -> None:
        if request.param == "ascii":
            there.port.write(f"V{round(1000 * max(0.0, speed_mps))}\n".encode())

    there.port.write(b"V0\n" if request.param == "ascii" else b"")
    yield Loop(settings, SerialActuator(settings, car(clock)), clock, pulses, reports)


def test_the_car_reaches_the_speed_that_the_commands_add_up_to(loop) -> None:
    loop.steps(STARTING, 0.0, 0.0)
    loop.steps(200, 0.0, 1.0)
    assert loop.speed_mps == pytest.approx(2.0, abs=0.4)  # 1 m/s² for 2 s, less the lags
    assert abs(loop.truth.lateral_offset_m) < 0.01


def test_the_car_turns_to_the_side_of_the_command(loop) -> None:
    loop.steps(STARTING, 0.0, 0.0)
    loop.steps(200, 0.0, 1.0)
    loop.steps(100, 0.1, 0.0)
    assert loop.truth.heading_error_rad > 0.02
    assert loop.truth.lateral_offset_m > 0.0


def test_the_limiter_stops_the_car_when_the_controller_is_silent(loop) -> None:
    loop.steps(STARTING, 0.0, 0.0)
    loop.steps(200, 0.0, 1.0)
    loop.steps(300)
    assert loop.speed_mps < 0.05
