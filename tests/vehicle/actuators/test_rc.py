"""The actuators of RC cars against counterparts that speak the wire."""

import math
import os
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from process_rig import until
from pydantic import ValidationError
from rc_rig import (
    STEERING,
    STEERING_CHANNEL,
    THROTTLE,
    THROTTLE_CHANNEL,
    BoardOnPty,
    Time,
    board,
    car,
    chip_on,
    command,
    pca,
)

from controller.limiter import build as build_limiter
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from vehicle.actuators.actuator import Actuator
from vehicle.actuators.node import ActuatorStep, Wire
from vehicle.actuators.rc import serial_board
from vehicle.actuators.rc.actuator import BRAKE_FROM_MPS2, PcaActuator, SerialActuator
from vehicle.actuators.rc.guard import Guard
from vehicle.actuators.rc.pca9685 import LED0_ON_L
from vehicle.actuators.rc.pulses import LEAD_MPS, SpeedIntegrator
from vehicle.actuators.rc.serial_board import encode_pulse
from vehicle.measurement.check import build as build_check

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
COUNT_US = 1e6 / 60 / 4096
CRASHING = """
import json, os, signal, sys, time
from rc_rig import Time, car, command, pca
from vehicle.actuators.rc.actuator import PcaActuator
clock = Time()
actuator = PcaActuator(pca(sys.argv[1]), car(clock))
for _ in range(100):
    clock.now_s += 0.01
    actuator.write(command(0.1, 1.0), now_s=clock.now_s)
print("driving", flush=True)
os.kill(os.getpid(), getattr(signal, sys.argv[2]))
time.sleep(60)
"""

SCRIPTED = frozenset({"speed_mps", "road_wheel_angle_rad", "yaw_rate_radps"})  # states of no car: range only


def drive(actuator, clock: Time, accel_mps2: float, seconds: float, angle_rad: float = 0.0) -> None:
    for _ in range(round(seconds / 0.01)):
        clock.now_s += 0.01
        actuator.read(now_s=clock.now_s)
        actuator.write(command(angle_rad, accel_mps2), now_s=clock.now_s)


def test_a_command_becomes_two_pulses_of_the_calibration(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        assert chip.frequency_hz == pytest.approx(60.0, rel=0.01)
        drive(actuator, clock, 1.0, 1.01, angle_rad=STEERING["left_rad"])
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(STEERING["left_us"], abs=COUNT_US)
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(1570.0, abs=COUNT_US)
        actuator.close()
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(STEERING["left_us"], abs=COUNT_US)  # held


def test_the_state_says_only_what_is_known(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c"):
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        drive(actuator, clock, 1.0, 4.0, angle_rad=2.0)
        state = actuator.read(now_s=clock.now_s)
        assert state.speed_mps == pytest.approx(3.0, abs=0.35)  # the end of the table, less its lag
        assert state.road_wheel_angle_rad == STEERING["left_rad"]
        assert 0.0 < state.yaw_rate_radps < 1.0
        actuator.close()


def test_an_unknown_speed_does_not_drive(tmp_path) -> None:
    with pytest.raises(InputError, match=r"speed: none: .*modelled"):
        PcaActuator(pca(tmp_path / "i2c", speed="none"), car(Time()))
    with pytest.raises(InputError, match=r"yaw_rate: none: .*modelled"):
        PcaActuator(pca(tmp_path / "i2c", yaw_rate="none"), car(Time()))


@pytest.mark.parametrize("side", ["left_rad", "right_rad"])
def test_wheels_that_turn_less_than_the_vehicle_file_says_do_not_start(tmp_path, side) -> None:
    settings = pca(tmp_path / "i2c", steering={**STEERING, side: 0.35})
    fault = rf"actuator\.yaml:\d+:\d+: pca9685\.steering\.{side}: 0\.35 rad.*to 0\.35"
    with pytest.raises(InputError, match=fault):
        PcaActuator(settings, car(Time()))


@pytest.mark.parametrize("lack_rad", [0.0, 0.029])
def test_the_end_of_the_steering_is_not_taken_for_a_driver(tmp_path, lack_rad) -> None:
    clock = Time()
    lock_rad = STEERING["left_rad"] - lack_rad
    settings = pca(tmp_path / "i2c", steering={**STEERING, "left_rad": lock_rad})
    with chip_on(tmp_path / "i2c"):
        actuator = PcaActuator(settings, car(clock))
        wire, node = wire_and_step(actuator, vehicle=car(clock).vehicle)
        run_loop(wire, node, clock, 200, 0.5)
        run_loop(wire, node, clock, 600, 0.0, STEERING["left_rad"])
        state = actuator.read(now_s=clock.now_s)
        assert (state.road_wheel_angle_rad, node._limiter.handed_over) == (lock_rad, False)
        actuator.close()


def test_an_absent_chip_is_one_line_with_the_remedy(tmp_path) -> None:
    with pytest.raises(InputError, match=r"i2c, address 0x40: cannot be opened: No such file.*i2cdetect"):
        PcaActuator(pca(tmp_path / "i2c"), car(Time()))
    with (
        chip_on(tmp_path / "i2c", address=0x41),
        pytest.raises(InputError, match="Remote I/O error"),
    ):
        PcaActuator(pca(tmp_path / "i2c"), car(Time()))


def test_a_chip_that_lost_its_power_is_reported_once_and_set_up_again(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        chip.power_on()
        assert chip.pulse_us(THROTTLE_CHANNEL) is None
        with pytest.raises(OSError, match="look at its power"):
            drive(actuator, clock, 1.0, 1.0)
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        actuator.close()


def test_an_actuator_that_starts_again_in_a_bend_leaves_the_wheels(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        first = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        drive(first, clock, 1.0, 2.0, angle_rad=0.3)
        held_us = chip.pulse_us(STEERING_CHANNEL)
        first._board.close()  # the end of a killed process
        second = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        assert chip.pulse_us(STEERING_CHANNEL) == held_us
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        wire, node = wire_and_step(second)
        run_loop(wire, node, clock, 100, 1.0)
        state = wire.read(clock.now_s)
        assert (state.speed_mps, state.yaw_rate_radps) == (None, None)
        assert state.road_wheel_angle_rad == pytest.approx(0.3, abs=0.005)
        assert chip.pulse_us(STEERING_CHANNEL) == held_us
        run_loop(wire, node, clock, 51, 1.0)
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(held_us, abs=20.0)
        run_loop(wire, node, clock, 100, 1.0)
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(STEERING["centre_us"], abs=COUNT_US)
        assert wire.read(clock.now_s).speed_mps > 0.5
        second.close()


def test_a_chip_that_holds_a_pulse_beyond_the_hard_ends_begins_at_the_centre(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        PcaActuator(pca(tmp_path / "i2c"), car(clock)).close()
        chip.write(bytes([LED0_ON_L + 4 * STEERING_CHANNEL, 0, 0, 0xFF, 0x01]))
        assert chip.pulse_us(STEERING_CHANNEL) > STEERING["most_us"] + 50
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(STEERING["centre_us"], abs=COUNT_US)
        assert actuator.read(now_s=clock.now_s).road_wheel_angle_rad == pytest.approx(0.0, abs=0.005)
        actuator.close()


@pytest.mark.parametrize("how", ["SIGKILL", "SIGSTOP"])
def test_the_guard_stops_a_car_whose_actuator_process_is_killed_or_frozen(tmp_path, how) -> None:
    with chip_on(tmp_path / "i2c") as chip:
        path = os.pathsep.join([str(ROOT), str(Path(__file__).parents[2] / "rigs")])
        process = subprocess.Popen(
            [sys.executable, "-c", CRASHING, str(tmp_path / "i2c"), how],
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": path},
        )
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"driving\n"
            assert until(
                lambda: (
                    chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
                ),
                patience_s=60,
            )
            assert chip.pulse_us(STEERING_CHANNEL) > STEERING["centre_us"] + 50  # the bend is held
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()


def test_a_guard_that_ended_is_a_failure_of_the_wire(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c"):
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        guard = actuator._board._guard.pid
        os.kill(guard, signal.SIGKILL)
        os.waitid(os.P_PID, guard, os.WEXITED | os.WNOWAIT)
        with pytest.raises(OSError, match="guard"):
            for _ in range(1000):
                drive(actuator, clock, 0.0, 0.1)
        with pytest.raises(OSError, match="guard"):
            actuator.close()


class Refusing:
    """A device that acknowledges nothing."""

    def write(self, data: bytes) -> None:
        raise OSError("refused")

    def close(self) -> None:
        pass


def test_a_chip_that_refuses_the_last_pulse_of_the_actuator_gets_it_from_the_guard(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        drive(actuator, clock, 1.0, 1.0)
        actuator._board.chip._device = Refusing()
        with pytest.raises(OSError, match="refused"):
            actuator.close()
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)


def test_a_frozen_guard_is_a_failure_of_the_wire(tmp_path) -> None:
    with chip_on(tmp_path / "i2c"):
        guard = Guard(pca(tmp_path / "i2c"), {THROTTLE_CHANNEL: THROTTLE["neutral_us"]})
        os.kill(guard.pid, signal.SIGSTOP)
        try:
            with pytest.raises(OSError, match="frozen"):
                for _ in range(1 << 21):  # more than a pipe holds
                    guard.alive()
        finally:
            os.kill(guard.pid, signal.SIGCONT)
            guard.close()


def speed_mps(actuator: SerialActuator, now_s: float) -> float | None:
    """The speed of the newest state."""
    state = actuator.read(now_s=now_s)
    return state and state.speed_mps


@pytest.fixture(autouse=True)
def _without_a_limit_of_time(monkeypatch) -> None:
    """A pty takes all bytes at once: a write is late only where this process waits for a processor."""
    monkeypatch.setattr(serial_board, "WRITE_TIMEOUT_S", 3600.0)


@pytest.fixture
def there(tmp_path) -> BoardOnPty:
    return BoardOnPty(tmp_path / "tty", "ascii")


def test_a_board_with_a_sensor_reports_the_measured_speed_until_it_is_old(there, tmp_path) -> None:
    clock = Time()
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    assert actuator.read(now_s=clock.now_s) is None
    there.port.write(b"V1250\nV12")
    assert until(lambda: speed_mps(actuator, clock.now_s) == 1.25, patience_s=60)
    assert speed_mps(actuator, clock.now_s + 0.19) == 1.25
    assert actuator.read(now_s=clock.now_s + 0.21) is None


def test_an_old_speed_does_not_drive_a_car_after_a_fault_of_the_wire(there, tmp_path, monkeypatch) -> None:
    clock, pulses_us = Time(), []
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    monkeypatch.setattr(actuator._board, "speed_mps", lambda now_s: (2.0, now_s))
    monkeypatch.setattr(actuator._board, "write", lambda pulses, now_s: pulses_us.append(pulses))
    drive(actuator, clock, 1.0, 1.0)

    def fail_reading(now_s: float) -> None:
        raise OSError("gone")

    monkeypatch.setattr(actuator._board, "speed_mps", fail_reading)
    with pytest.raises(OSError, match="gone"):
        actuator.read(now_s=clock.now_s)
    actuator.write(command(0.0, 1.0), now_s=clock.now_s)
    assert pulses_us[-1][THROTTLE_CHANNEL] == THROTTLE["neutral_us"]


def test_a_serial_board_gets_no_steering_before_the_car_stands(there, tmp_path) -> None:
    clock = Time()
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    wire, node = wire_and_step(actuator, "serial")

    def has_reported(speed_mps: float) -> bool:
        there.turn(clock.now_s, b"V%d\n" % round(1000 * speed_mps))
        run_loop(wire, node, clock, 1, 0.5, angle_rad=0.2)
        state = actuator.read(now_s=clock.now_s)
        return state is not None and state.speed_mps == speed_mps

    assert until(lambda: has_reported(2.0), patience_s=60)
    assert actuator.read(now_s=clock.now_s).road_wheel_angle_rad is None
    assert until(lambda: has_reported(1.0), patience_s=60)
    assert there.board.pulses_us == {THROTTLE_CHANNEL: THROTTLE["neutral_us"]}
    assert until(lambda: has_reported(0.0), patience_s=60)
    run_loop(wire, node, clock, 3, 0.5, angle_rad=0.2)
    assert until(lambda: there.turn(clock.now_s) or STEERING_CHANNEL in there.board.pulses_us, patience_s=60)


def test_without_a_measured_speed_a_board_with_a_sensor_is_not_driven(there, tmp_path) -> None:
    clock = Time()
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    drive(actuator, clock, 2.0, 1.0)
    assert until(lambda: there.turn(clock.now_s) or there.board.pulses_us, patience_s=60)
    assert there.board.pulses_us[THROTTLE_CHANNEL] == THROTTLE["neutral_us"]


@pytest.mark.parametrize(
    "accel_mps2, measured_mps, neutral",
    [(1.0, 2.0, False), (-1.0, 2.0, False), (-BRAKE_FROM_MPS2, 2.0, True), (1.0, None, True)],
)
def test_a_hard_brake_and_a_silent_sensor_leave_the_throttle_neutral(
    there, tmp_path, monkeypatch, accel_mps2, measured_mps, neutral
) -> None:
    clock, pulses_us = Time(), []
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    speed = lambda now_s: None if measured_mps is None else (measured_mps, now_s)  # noqa: E731
    monkeypatch.setattr(actuator._board, "speed_mps", lambda now_s: (2.0, now_s))
    drive(actuator, clock, 1.0, 1.0)
    monkeypatch.setattr(actuator._board, "speed_mps", speed)
    monkeypatch.setattr(actuator._board, "write", lambda pulses, now_s: pulses_us.append(pulses))
    drive(actuator, clock, accel_mps2, 0.01)
    assert (pulses_us[-1][THROTTLE_CHANNEL] == THROTTLE["neutral_us"]) == neutral


@pytest.mark.parametrize("protocol", ["ascii", "maestro"])
def test_both_protocols_carry_the_pulses(tmp_path, protocol) -> None:
    clock, there = Time(), BoardOnPty(tmp_path / "tty", protocol)
    actuator = SerialActuator(board(tmp_path / "tty", protocol=protocol, speed="modelled"), car(clock))
    for _ in range(150):
        drive(actuator, clock, 1.0, 0.01, angle_rad=-STEERING["right_rad"])
        there.turn(clock.now_s)
    sent = there.board.pulses_us
    assert until(
        lambda: there.turn(clock.now_s) or sent[STEERING_CHANNEL] == STEERING["right_us"], patience_s=60
    )
    assert sent[THROTTLE_CHANNEL] == pytest.approx(1590.0, abs=2.0)
    assert there.board.errors == 0


def wire_and_step(
    actuator: Actuator, name: str = "pca9685", vehicle: Vehicle = VEHICLE
) -> tuple[Wire, ActuatorStep]:
    """The parts of the actuator process."""
    step = ActuatorStep(build_limiter(vehicle), build_check(vehicle, computed=SCRIPTED))
    return Wire(actuator, name), step


def run_loop(
    wire: Wire, node: ActuatorStep, clock: Time, turns: int, accel_mps2: float, angle_rad: float = 0.0
) -> None:
    """Turns of the actuator process with fresh commands."""
    for _ in range(turns):
        clock.now_s += 0.01
        failures, state = wire.failures, wire.read(clock.now_s)
        order = replace(command(angle_rad, accel_mps2), t_s=clock.now_s)
        failed = wire.failures > failures
        applied = node.step(order, clock.now_s, state, stop=failed, now_s=clock.now_s)
        if applied.command is not None:
            wire.write(applied.command, clock.now_s)


@pytest.mark.parametrize("pause_s", [0.3, 0.6])
def test_after_a_freeze_of_the_process_the_throttle_stays_neutral_until_standstill(tmp_path, pause_s) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        wire, node = wire_and_step(actuator)
        run_loop(wire, node, clock, 300, 0.7)
        assert chip.pulse_us(THROTTLE_CHANNEL) > THROTTLE["neutral_us"] + 50
        before_mps = actuator.read(now_s=clock.now_s).speed_mps
        clock.now_s += pause_s
        run_loop(wire, node, clock, 1, 0.7)
        assert "went to neutral" in wire.last
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        decayed_mps = before_mps * math.exp(-(pause_s - 0.19) / 0.3)
        assert actuator.read(now_s=clock.now_s).speed_mps == pytest.approx(decayed_mps, abs=0.005)
        run_loop(wire, node, clock, 10, 0.7)
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        assert wire.failures == 1
        actuator.close()


def test_after_a_freeze_until_standstill_the_car_starts_from_standstill(tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        wire, node = wire_and_step(actuator)
        run_loop(wire, node, clock, 300, 0.7)
        clock.now_s += 5.0
        run_loop(wire, node, clock, 1, 0.7)
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=COUNT_US)
        run_loop(wire, node, clock, 20, 0.7)
        assert chip.pulse_us(THROTTLE_CHANNEL) < 1540.0
        actuator.close()


def test_a_silence_of_the_serial_board_is_a_failure_of_the_wire_once(there, tmp_path) -> None:
    clock = Time()
    actuator = SerialActuator(board(tmp_path / "tty", speed="modelled"), car(clock))
    drive(actuator, clock, 1.0, 1.0)
    clock.now_s += 0.2
    drive(actuator, clock, 1.0, 0.1)
    clock.now_s += 0.3
    with pytest.raises(OSError, match=r"no pulses for 0\.31 s"):
        drive(actuator, clock, 1.0, 0.01)
    assert actuator._motion.demand_mps == 0.0
    drive(actuator, clock, 0.0, 0.1)


@pytest.mark.parametrize(
    "protocol, baud, fits",
    [("ascii", 19200, False), ("ascii", 38400, True), ("maestro", 9600, False), ("maestro", 19200, True)],
)
def test_a_baud_rate_that_cannot_carry_the_pulses_is_refused(tmp_path, protocol, baud, fits) -> None:
    changed = dict(protocol=protocol, baud=baud, speed="modelled")
    if fits:
        settings = board(tmp_path / "tty", **changed)
        sent = sum(len(encode_pulse(protocol, channel, 1500.0)) for channel in settings.rest_us)
        assert 1.5 * 100 * sent <= baud / 10
    else:
        with pytest.raises(ValidationError, match=f"two pulses at 100 Hz with {protocol} need at least"):
            board(tmp_path / "tty", **changed)


def test_a_maestro_that_does_not_answer_is_a_failure_of_the_wire(tmp_path) -> None:
    clock, _ = Time(), BoardOnPty(tmp_path / "tty", "maestro")
    actuator = SerialActuator(board(tmp_path / "tty", protocol="maestro", speed="modelled"), car(clock))
    with pytest.raises(OSError, match="does not answer"):
        drive(actuator, clock, 1.0, 2.0)


def test_the_board_stops_the_car_when_the_wire_is_silent(there) -> None:
    there.board.feed(b"S0 1600\n", now_s=1.0)
    there.board.watch(now_s=1.2)
    assert there.board.pulses_us[THROTTLE_CHANNEL] == 1600.0
    there.board.watch(now_s=1.3)
    assert there.board.pulses_us[THROTTLE_CHANNEL] == THROTTLE["neutral_us"]


def test_a_board_that_returns_is_driven_again_without_a_restart(tmp_path) -> None:
    clock, first = Time(), BoardOnPty(tmp_path / "tty", "ascii")
    actuator = SerialActuator(board(tmp_path / "tty"), car(clock))
    first.port.close()
    with pytest.raises(OSError):
        drive(actuator, clock, 0.0, 1.0)
    second = BoardOnPty(tmp_path / "tty", "ascii")
    clock.now_s += 1.0
    actuator.write(command(0.0, 0.0), now_s=clock.now_s)
    assert until(lambda: second.turn(clock.now_s) or second.board.pulses_us, patience_s=60)


def test_the_demand_stays_near_the_measured_speed() -> None:
    motion = SpeedIntegrator(0.3)
    for tick in range(1000):
        motion.step(1.0, 3.0, 0.4, now_s=0.01 * tick)
    assert motion.demand_mps == pytest.approx(0.4 + LEAD_MPS)


def speeds_by(
    motion: SpeedIntegrator, factor: float, speed_mps: float, accel_mps2: float, *, seconds: float
) -> list[float]:
    """Speeds of a car with a sensor that drives ``factor`` times the demand after a lag of 0.3 s."""
    speeds_mps = [speed_mps]
    for tick in range(round(seconds / 0.01)):
        demand_mps = motion.step(accel_mps2, 3.0, speeds_mps[-1], now_s=0.01 * tick)
        speeds_mps.append(
            speeds_mps[-1] + (factor * demand_mps - speeds_mps[-1]) * (1.0 - math.exp(-0.01 / 0.3))
        )
    return speeds_mps


@pytest.mark.parametrize("accel_mps2", [-0.2, -1.0])
@pytest.mark.parametrize("factor", [0.7, 0.85, 1.0, 1.15, 1.3, 1.4, 1.5])
def test_a_brake_never_raises_the_speed_of_a_car_that_differs_from_its_table(factor, accel_mps2) -> None:
    motion = SpeedIntegrator(0.3)
    motion.demand_mps = 2.0 / factor
    speeds_mps = speeds_by(motion, factor, 2.0, accel_mps2, seconds=30.0)
    assert all(after <= before + 1e-9 for before, after in pairwise(speeds_mps))
    assert speeds_mps[-1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("factor", [1.0, 1.4, 1.5])
def test_a_small_acceleration_does_not_run_away_on_a_car_that_is_faster_than_its_table(factor) -> None:
    motion = SpeedIntegrator(0.3)
    motion.demand_mps = 2.0 / factor
    assert speeds_by(motion, factor, 2.0, 0.05, seconds=4.0)[-1] == pytest.approx(
        2.0 + 0.2 * factor, abs=0.05
    )


def test_after_neutral_an_acceleration_takes_a_rolling_car_up_near_its_speed() -> None:
    motion = SpeedIntegrator(0.3)
    assert motion.step(-1.0, 0.0, 2.0, now_s=0.0) == 0.0
    assert motion.step(0.0, 3.0, 2.0, now_s=0.01) == 0.0
    assert motion.step(0.5, 3.0, 2.0, now_s=0.02) == pytest.approx(2.0 - LEAD_MPS, abs=0.01)


def test_a_brake_ends_in_standstill_and_not_in_reverse() -> None:
    motion = SpeedIntegrator(0.3)
    for tick in range(100):
        motion.step(2.0, 3.0, None, now_s=0.01 * tick)
    for tick in range(100, 900):
        motion.step(-BRAKE_FROM_MPS2, 3.0, None, now_s=0.01 * tick)
    assert (motion.demand_mps, motion.modelled_mps) == (0.0, 0.0)
