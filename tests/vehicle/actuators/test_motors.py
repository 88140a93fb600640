"""Two driven wheels against a chip that answers on a socket: closed forms of the wheel speeds, refusals."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from process_rig import until
from pydantic import ValidationError
from rc_rig import FILE, Time, chip_on, command

from cockpit.car.init import Like, template_files, write_car
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, using_car
from vehicle.actuators.actuator import Car
from vehicle.actuators.rc.motors import MotorActuator, MotorSettings
from vehicle.actuators.table import configured_actuator

ADDRESS = FILE["motor_hat"]["address"]
VEHICLE = load(template_files(Like.DUCKIEBOT)["vehicle.yaml"], Vehicle)


def motors(path: Path, **changed: Any) -> MotorSettings:
    block = {**FILE["motor_hat"], "bus": f"unix:{path}", "state": "modelled", "wait_s": 0}
    return MotorSettings(**{**block, **changed})


ANY = motors(Path("/nowhere"))


def duckiebot(clock: Time, **changed: Any) -> Car:
    return Car(VEHICLE.model_copy(update=changed), None, clock)


@given(st.floats(0.01, 0.6), st.floats(-8, 8))
@settings(max_examples=40, deadline=None)
def test_the_wheels_give_speed_and_curvature_back(speed_mps, curvature_1pm):
    left_mps, right_mps = ANY.wheel_speeds(speed_mps, curvature_1pm)
    assert (left_mps + right_mps) / 2 == pytest.approx(speed_mps)
    assert (right_mps - left_mps) / ANY.apart_m == pytest.approx(speed_mps * curvature_1pm, abs=1e-12)
    assert ANY.wheel_speeds(speed_mps, -curvature_1pm) == (right_mps, left_mps)


@given(st.floats(0, 0.8), st.floats(0, 0.8))
@settings(max_examples=40, deadline=None)
def test_a_faster_wheel_has_a_larger_duty_and_a_standing_one_none(one, other):
    motor = ANY.left
    slower, faster = sorted((one, other))
    assert motor.duty_at(slower) <= motor.duty_at(faster) <= 1.0
    assert motor.duty_at(0.0) == 0.0


def test_a_robot_drives_an_arc_with_the_inner_wheel_slower_and_brakes_when_it_ends(tmp_path):
    clock, angle_rad = Time(), 0.3
    with chip_on(tmp_path / "i2c", ADDRESS) as chip:
        actuator = MotorActuator(motors(tmp_path / "i2c"), duckiebot(clock))
        duty = {side: getattr(ANY, side).duty for side in ("left", "right")}
        assert [chip.pulse_us(channel) for channel in duty.values()] == [None, None]
        for side in (ANY.left, ANY.right):
            assert chip.pulse_us(side.ahead) == pytest.approx(1e6 / chip.frequency_hz, rel=1e-3)
            assert chip.pulse_us(side.back) is None
        for number in range(200):
            clock.now_s += 0.01
            actuator.read(now_s=clock.now_s)
            actuator.write(command(angle_rad, 0.2 if number < 150 else 0.0), now_s=clock.now_s)
        shares = {side: chip.pulse_us(duty[side]) * chip.frequency_hz * 1e-6 for side in duty}
        half = math.tan(angle_rad) / VEHICLE.wheelbase_m * ANY.apart_m / 2
        table = ANY.left.speeds
        expected = {
            side: table[0][1] + (table[1][1] - table[0][1]) * 0.3 * (1 + sign * half) / table[1][0]
            for side, sign in (("left", -1), ("right", 1))
        }
        assert shares == pytest.approx(expected, abs=0.01)
        state = actuator.read(now_s=clock.now_s)
        assert state.speed_mps == pytest.approx(0.3, abs=0.02)
        assert state.road_wheel_angle_rad == angle_rad
        assert state.yaw_rate_radps == pytest.approx(0.3 * 2 * half / ANY.apart_m, rel=0.1)
        actuator.close()
        assert [chip.pulse_us(channel) for channel in duty.values()] == [None, None]


def test_where_the_outer_wheel_is_at_its_end_the_speed_gives_way_to_the_curvature(tmp_path):
    clock, angle_rad = Time(), VEHICLE.max_road_wheel_angle_rad
    with chip_on(tmp_path / "i2c", ADDRESS) as chip:
        actuator = MotorActuator(motors(tmp_path / "i2c"), duckiebot(clock))
        for _ in range(300):
            clock.now_s += 0.01
            actuator.write(command(angle_rad, 1.0), now_s=clock.now_s)
        half = math.tan(angle_rad) / VEHICLE.wheelbase_m * ANY.apart_m / 2
        assert chip.pulse_us(ANY.right.duty) * chip.frequency_hz * 1e-6 == pytest.approx(1.0, abs=0.01)
        slow_mps = ANY.most_mps * (1 - half) / (1 + half)
        assert chip.pulse_us(ANY.left.duty) * chip.frequency_hz * 1e-6 == pytest.approx(
            ANY.left.duty_at(slow_mps), abs=0.01
        )
        actuator.close()


def test_a_process_that_falls_silent_leaves_braked_motors(tmp_path):
    clock = Time()
    with chip_on(tmp_path / "i2c", ADDRESS) as chip:
        actuator = MotorActuator(motors(tmp_path / "i2c", guard_s=0.1), duckiebot(clock))
        driven = []
        for _ in range(50):
            clock.now_s += 0.01
            actuator.write(command(0.0, 1.0), now_s=clock.now_s)
            driven.append(chip.pulse_us(ANY.left.duty))
        assert any(driven)
        duties = ANY.left.duty, ANY.right.duty
        assert until(lambda: [chip.pulse_us(duty) for duty in duties] == [None, None], patience_s=20.0)
        clock.now_s += 0.2
        with pytest.raises(OSError, match="no pulses for"):
            actuator.read(now_s=clock.now_s)
        assert actuator.read(now_s=clock.now_s).speed_mps < 0.2
        actuator.close()


def test_a_car_that_would_turn_its_inner_wheel_backwards_does_not_start(tmp_path):
    car = duckiebot(Time(), max_road_wheel_angle_rad=1.15)
    with pytest.raises(InputError, match=r"motor_hat\.apart_m: at 0\.1 m .* inner one stands at 1\.11 rad"):
        MotorActuator(motors(tmp_path / "i2c"), car)


def test_an_unknown_speed_does_not_drive(tmp_path):
    with pytest.raises(InputError, match=r"motor_hat\.state: none: .*modelled"):
        MotorActuator(motors(tmp_path / "i2c", state="none"), duckiebot(Time()))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"duty": 10}, "channel 10 is taken already"),
        ({"speeds": [[0.0, 0.5], [0.4, 0.5]]}, "must rise"),
        ({"speeds": [[0.0, 0.2]]}, "at least one speed above 0"),
        ({"speeds": [[0.4, 1.2]]}, "less than or equal to 1"),
    ],
)
def test_a_wheel_that_cannot_be_is_refused(changed, says):
    with pytest.raises(ValidationError, match=says):
        motors(Path("/nowhere"), right={**FILE["motor_hat"]["right"], **changed})


def test_the_template_drives_as_it_is(tmp_path):
    write_car(tmp_path / "mybot", Like.DUCKIEBOT)
    with using_car(tmp_path / "mybot"), chip_on(tmp_path / "i2c", ADDRESS):
        name, block = configured_actuator()
        car = Car(load(CONFIG_DIR / "vehicle.yaml", Vehicle), None, Time())
        actuator = MotorActuator(block.model_copy(update={"bus": f"unix:{tmp_path / 'i2c'}"}), car)
        actuator.close()
    assert (name, car.vehicle.name) == ("motor_hat", "duckiebot")
