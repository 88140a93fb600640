"""`trepid calibrate steering`: keys and values to pulses, and to the actuator.yaml of a car."""

import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from process_rig import until
from rc_rig import STEERING, STEERING_CHANNEL, THROTTLE, THROTTLE_CHANNEL, Time, car, chip_on, command, pca

from cockpit.calibration.rc_file import settings_of, write
from cockpit.calibration.rc_session import DOWN, IDLE_S, LEFT, RIGHT, UP, Session
from sim_harness.counterparts.pca9685 import Registers
from trepid.cli import main
from trepid.config import use_car
from vehicle.actuators.rc.actuator import PcaActuator

TEXT = """# My car.
actuator: pca9685   # the chip under the roof
pca9685:
  bus: unix:{path}
  speed: modelled  # no encoder yet
  wait_s: 0
  steering:
    left_us: 1880.0    # touches at 1895
"""


@pytest.fixture
def mine(tmp_path):
    """The folder of a car with a chip on a socket."""
    folder = tmp_path / "mycar"
    folder.mkdir()
    (folder / "actuator.yaml").write_text(TEXT.format(path=tmp_path / "i2c"))
    use_car(folder)
    yield folder
    use_car(None)


def calibrate(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["trepid", "calibrate", "steering", *arguments])
    return main()


def test_values_are_written_and_comments_stay(mine, monkeypatch, capsys) -> None:
    assert calibrate(
        monkeypatch, "--file-only", "--json", "--centre", "1480", "--right-deg", "24", "--speed", "2=1620",
        "--speed", "1=1580",
    ) == 0  # fmt: skip
    text = (mine / "actuator.yaml").read_text()
    for kept in ("# My car.", "# the chip under the roof", "# no encoder yet", "1880.0    # touches at 1895"):
        assert kept in text
    found = settings_of("pca9685")
    assert found.steering.centre_us == 1480.0
    assert found.steering.left_us == 1880.0
    assert found.steering.right_rad == pytest.approx(0.4189)
    assert found.throttle.speeds == ((1.0, 1580.0), (2.0, 1620.0))
    assert json.loads(capsys.readouterr().out)["steering.centre_us"] == 1480.0


def test_a_car_without_the_file_gets_one(tmp_path) -> None:
    use_car(tmp_path)
    try:
        path = write(tmp_path, "serial", {"steering.centre_us": 1490.0})
        assert path.read_text().startswith("#")
        assert settings_of("serial").steering.centre_us == 1490.0
    finally:
        use_car(None)


@pytest.mark.parametrize(
    "arguments, line",
    [
        (("--centre", "1990"), "must lie between left_us and right_us"),
        (("--left", "2100"), "outside of least_us..most_us"),
        (("--speed", "fast"), "--speed fast: expected MPS=US"),
        (("--board", "can"), "--board can: expected pca9685 or serial"),
        ((), "--file-only needs values"),
    ],
)
def test_a_wrong_value_is_one_line_and_changes_nothing(mine, monkeypatch, capsys, arguments, line) -> None:
    before = (mine / "actuator.yaml").read_text()
    assert calibrate(monkeypatch, "--file-only", *arguments) == 2
    said = capsys.readouterr().err
    assert line in said
    assert "actuator.yaml:" not in said  # no file holds the value
    assert said.count("\n") == 1
    assert (mine / "actuator.yaml").read_text() == before


def test_without_a_car_the_verb_names_the_option(monkeypatch, capsys) -> None:
    assert calibrate(monkeypatch, "--centre", "1490") == 2
    assert "--car DIR" in capsys.readouterr().err


def drive_on(actuator: PcaActuator, clock: Time) -> None:
    """For longer than the actuator takes to look at the file."""
    for _ in range(60):
        clock.now_s += 0.01
        actuator.write(command(0.0, 0.0), now_s=clock.now_s)


def test_a_running_drive_takes_a_new_calibration_over(mine, tmp_path) -> None:
    clock = Time()
    with chip_on(tmp_path / "i2c") as chip:
        actuator = PcaActuator(pca(tmp_path / "i2c"), car(clock))
        write(mine, "pca9685", {"steering.centre_us": 1450.0})
        drive_on(actuator, clock)
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(1450.0, abs=5.0)
        before = (mine / "actuator.yaml").read_text()
        (mine / "actuator.yaml").write_text("actuator: [")
        drive_on(actuator, clock)
        assert chip.pulse_us(STEERING_CHANNEL) == pytest.approx(1450.0, abs=5.0)
        assert "actuator.yaml" in dict(actuator.values())["calibration"]
        (mine / "actuator.yaml").write_text(before)
        write(mine, "pca9685", {"throttle.neutral_us": 1490.0})  # the guard would set the old one
        drive_on(actuator, clock)
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=4.1)
        assert "neutral_us" in dict(actuator.values())["calibration"]
        write(mine, "pca9685", {"throttle.neutral_us": THROTTLE["neutral_us"], "steering.left_rad": 0.35})
        drive_on(actuator, clock)
        assert ":10:5: pca9685.steering.left_rad: 0.35 rad is" in dict(actuator.values())["calibration"]
        actuator.close()


def test_an_angle_smaller_than_that_of_the_vehicle_file_is_written_with_a_warning(
    mine, monkeypatch, capsys
) -> None:
    (mine / "vehicle.yaml").write_text("max_road_wheel_angle_rad: 0.45\n")
    assert calibrate(monkeypatch, "--file-only", "--left-deg", "20") == 0
    assert settings_of("pca9685").steering.left_rad == pytest.approx(0.3491)
    said = capsys.readouterr().err
    assert "warning" in said and "set max_road_wheel_angle_rad to 0.3491" in said
    assert calibrate(monkeypatch, "--file-only", "--left-deg", "25") == 0
    assert capsys.readouterr().err == ""


def test_keys_move_in_small_steps_within_the_hard_ends_and_record() -> None:
    session = Session(pca(Path("none")))
    session.press(LEFT, now_s=0.0)
    assert session.pulses(now_s=0.0)[STEERING_CHANNEL] == STEERING["centre_us"] - 5.0
    session.press("c", now_s=0.1)
    for _ in range(100):
        session.press(UP, now_s=0.2)
    assert session.pulses(now_s=0.2)[STEERING_CHANNEL] == STEERING["most_us"]
    session.press(RIGHT, now_s=0.2)
    session.press(DOWN, now_s=0.2)
    session.press("l", now_s=0.3)
    assert session.changes == {"steering.centre_us": 1495.0, "steering.left_us": 1975.0}
    assert session.press("w", now_s=0.4).writes
    assert session.press("q", now_s=0.4).ends


def test_a_throttle_without_keys_returns_to_neutral() -> None:
    session = Session(pca(Path("none")))
    session.press("t", now_s=0.0)
    session.press(UP, now_s=0.1)
    assert session.pulses(now_s=0.1 + IDLE_S)[THROTTLE_CHANNEL] == THROTTLE["neutral_us"] + 25.0
    assert session.pulses(now_s=0.2 + IDLE_S)[THROTTLE_CHANNEL] == THROTTLE["neutral_us"]
    session.press(UP, now_s=9.0)
    assert session.press("v", now_s=9.1).asks_speed
    session.speed(0.8)
    session.press(UP, now_s=9.2)
    session.speed(1.5)
    assert session.changes["throttle.speeds"] == [[0.8, 1525.0], [1.5, 1550.0]]


def test_forgotten_speeds_are_not_written() -> None:
    session = Session(pca(Path("none")))
    session.press("t", now_s=0.0)
    session.press("n", now_s=0.1)
    session.speed(1.0)
    session.press("x", now_s=0.2)
    assert session.changes == {"throttle.neutral_us": THROTTLE["neutral_us"]}
    session.speed(2.0, pulse_us=1600.0)
    assert session.changes["throttle.speeds"] == [[2.0, 1600.0]]


class AtKeys:
    """A calibration in a terminal."""

    def __init__(self, folder: Path) -> None:
        self._master, self._slave = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "trepid", "calibrate", "steering", "--car", str(folder)],
            stdin=self._slave,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        os.set_blocking(self.process.stderr.fileno(), False)
        self._said = b""

    def press(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def says(self, text: str) -> bool:
        """Whether ``text`` comes; what was said up to it counts no more."""

        def came() -> bool:
            self._said += self.process.stderr.read() or b""
            return text.encode() in self._said

        if not until(came, patience_s=30):
            return False
        self._said = self._said.partition(text.encode())[2]
        return True

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stderr.close()
        os.close(self._master)
        os.close(self._slave)


@pytest.fixture
def at_keys(mine, tmp_path) -> Iterator[tuple[AtKeys, Registers]]:
    """A calibration by keys, and the chip that it moves."""
    with chip_on(tmp_path / "i2c") as chip:
        made = AtKeys(mine)
        try:
            assert until(lambda: chip.pulse_us(STEERING_CHANNEL) is not None, patience_s=30)
            yield made, chip
        finally:
            made.close()


def test_keys_of_a_terminal_move_the_servo_and_write_the_file(at_keys) -> None:
    terminal, chip = at_keys
    moved = STEERING["centre_us"] + 10.0
    terminal.press(RIGHT * 2)
    assert until(lambda: chip.pulse_us(STEERING_CHANNEL) == pytest.approx(moved, abs=4.1), patience_s=30)
    terminal.press("cw")
    assert terminal.process.wait(30) == 0
    assert settings_of("pca9685").steering.centre_us == moved


def test_a_typed_speed_can_be_edited_and_is_asked_for_until_it_is_one(at_keys) -> None:
    terminal, _ = at_keys
    terminal.press(RIGHT + "ct" + UP * 3)
    assert terminal.says("throttle 1575")
    terminal.press("v")
    assert terminal.says("speed [m/s]? ")
    terminal.press("fast\n")
    assert terminal.says("fast: Input should be a valid number")
    assert terminal.says("speed [m/s]? ")
    terminal.press("-1\n")
    assert terminal.says("-1: Input should be greater than or equal to 0; speed [m/s]? ")
    terminal.press("1.9\x7f5\n")
    assert terminal.says("1.5 m/s at 1575 µs")
    terminal.press("v")
    assert terminal.says("speed [m/s]? ")
    terminal.press("\n")
    assert terminal.says("no speed recorded")
    terminal.press("w")
    assert terminal.process.wait(30) == 0
    found = settings_of("pca9685")
    assert found.throttle.speeds == ((1.5, 1575.0),)
    assert found.steering.centre_us == STEERING["centre_us"] + 5.0


def test_values_that_do_not_fit_together_are_named_and_the_session_goes_on(at_keys, mine) -> None:
    terminal, _ = at_keys
    terminal.press(RIGHT + "ctv")
    assert terminal.says("speed [m/s]? ")
    terminal.press("1.0\n")
    assert terminal.says("1 m/s at 1500 µs")
    before = (mine / "actuator.yaml").read_text()
    terminal.press("w")
    assert terminal.says("not written: pca9685.throttle.speeds.0: speeds must rise")
    assert (mine / "actuator.yaml").read_text() == before
    terminal.press("x")
    assert terminal.says("no speeds recorded")
    terminal.press("w")
    assert terminal.process.wait(30) == 0
    assert settings_of("pca9685").steering.centre_us == STEERING["centre_us"] + 5.0


def test_the_escape_key_takes_no_other_key_with_it(at_keys) -> None:
    terminal, _ = at_keys
    terminal.press("\x1b")
    assert terminal.says("arrows")  # the line of help at the start
    assert terminal.says("arrows")  # for a key without a meaning
    terminal.press("c")
    assert terminal.says("steering.centre_us = 1500")
    terminal.press("q")
    assert terminal.process.wait(30) == 0


def test_values_are_shown_by_the_servo_before_they_are_written(mine, tmp_path, monkeypatch) -> None:
    with chip_on(tmp_path / "i2c") as chip:
        seen = []
        real = chip.write
        monkeypatch.setattr(
            chip, "write", lambda data: (real(data), seen.append(chip.pulse_us(STEERING_CHANNEL)))
        )
        assert calibrate(monkeypatch, "--left", "1800", "--right", "1200") == 0
        pulses = [pulse for pulse in seen if pulse is not None]
        assert max(pulses) == pytest.approx(1800.0, abs=4.1)
        assert min(pulses) == pytest.approx(1200.0, abs=4.1)
        assert max(abs(b - a) for a, b in pairwise(pulses)) < 15.0
        assert chip.pulse_us(THROTTLE_CHANNEL) == pytest.approx(THROTTLE["neutral_us"], abs=4.1)
