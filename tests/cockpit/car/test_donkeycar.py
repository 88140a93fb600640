"""A car from the ``myconfig.py`` of a donkeycar, which is read and never run."""

from pathlib import Path

import pytest
from rc_rig import FLAT

from cockpit.car.donkeycar import read_donkeycar
from trepid.cli import main
from trepid.config import CAR, use_car
from vehicle.actuators.rc.settings import PcaSettings
from vehicle.actuators.table import configured_actuator
from vehicle.cameras.table import configured_source as configured_camera

# As `donkey createcar` writes it (donkeycar 5.3), with the usual edits.
MYCONFIG = """\
# import os
CAMERA_TYPE = "PICAM"
CAMERA_VFLIP = True
CAMERA_HFLIP = True
DRIVE_TRAIN_TYPE = "PWM_STEERING_THROTTLE"
PWM_STEERING_THROTTLE = {
    "PWM_STEERING_PIN": "PCA9685.1:41.2",
    "PWM_STEERING_SCALE": 1.0,
    "PWM_STEERING_INVERTED": False,
    "PWM_THROTTLE_PIN": "PCA9685.1:41.0",
    "PWM_THROTTLE_SCALE": 1.0,
    "PWM_THROTTLE_INVERTED": False,
    "STEERING_LEFT_PWM": 460,
    "STEERING_RIGHT_PWM": 290,
    "THROTTLE_FORWARD_PWM": 500,
    "THROTTLE_STOPPED_PWM": 370,
    "THROTTLE_REVERSE_PWM": 220,
}
JOYSTICK_MAX_THROTTLE = 0.8
"""


def write_config(folder: Path, text: str) -> Path:
    path = folder / "myconfig.py"
    path.write_text(text)
    return path


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, "")  # restored after the test
    return tmp_path / "mycar"


def init(monkeypatch: pytest.MonkeyPatch, car: Path, text: str) -> int:
    words = ["init", str(car), "--like", "rc-car", "--donkeycar", str(write_config(car.parent, text))]
    monkeypatch.setattr("sys.argv", ["trepid", *words])
    return main()


def actuator() -> PcaSettings:
    name, settings = configured_actuator()
    assert name == "pca9685" and isinstance(settings, PcaSettings)
    return settings


def test_pulses_are_counts_of_a_period_of_60_hz_and_pins_give_bus_address_and_channels(
    car: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert init(monkeypatch, car, MYCONFIG) == 0
    out = capsys.readouterr().out
    assert "Not taken over: JOYSTICK_MAX_THROTTLE (line 19)" in out
    use_car(car)
    found = actuator()
    assert (found.bus, found.address) == ("/dev/i2c-1", 0x41)
    assert (found.steering.channel, found.throttle.channel) == (2, 0)
    assert found.steering.left_us == round(460 / 4095 * 1e6 / 60)
    assert found.steering.right_us == round(290 / 4095 * 1e6 / 60)
    assert found.throttle.neutral_us == round(370 / 4095 * 1e6 / 60)
    assert found.speed == "none", "no speed was measured: the car does not drive"
    assert abs(found.throttle.pulse_us(9.0) - found.throttle.neutral_us) <= 1, (
        "the pulse of any demanded speed is the neutral one"
    )


def test_a_camera_that_hangs_upside_down_is_turned(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert init(monkeypatch, car, MYCONFIG) == 0
    use_car(car)
    name, _, common = configured_camera()
    assert name == "picamera" and common.mount.rotate_deg == 180 and common.mount.mirror == "none"


def test_names_of_older_versions_and_a_servo_that_turns_the_other_way_are_taken_over(
    car: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert init(monkeypatch, car, FLAT) == 0
    use_car(car)
    steering = actuator().steering
    assert steering.channel == 3 and steering.left_us < steering.centre_us < steering.right_us


def test_the_file_is_never_run(tmp_path: Path) -> None:
    spy = tmp_path / "ran"
    text = f"import pathlib\npathlib.Path({str(spy)!r}).touch()\nDATA_PATH = pathlib.Path('data')\n" + FLAT
    found = read_donkeycar(write_config(tmp_path, text))
    assert not spy.exists() and "DATA_PATH (line 3)" in found.left


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("DRIVE_TRAIN_TYPE = 'I2C_SERVO'\nSTEERING_LEFT_PWM = (\n", "myconfig.py:2:21: no Python"),
        ("DRIVE_TRAIN_TYPE = 'VESC'\n", "myconfig.py:1:1: DRIVE_TRAIN_TYPE: 'VESC'"),
        ("CAMERA_TYPE = 'PICAM'\n", "myconfig.py:1:1: no PWM_STEERING_THROTTLE"),
        (FLAT.replace("= 300", "= 300 + 5"), "myconfig.py:3:1: STEERING_LEFT_PWM: is computed"),
        (FLAT.replace("= 300", "= 1500"), "myconfig.py:3:1: STEERING_LEFT_PWM: 1500 counts"),
        (FLAT.replace("= 300", "= 'left'"), "myconfig.py:3:1: STEERING_LEFT_PWM"),
        (
            MYCONFIG.replace("PCA9685.1:41.2", "RPI_GPIO.BOARD.33"),
            "myconfig.py:6:1: PWM_STEERING_THROTTLE: pin",
        ),
        (MYCONFIG.replace('INVERTED": False', 'INVERTED": True', 1), "not taken over"),
    ],
)
def test_what_cannot_be_taken_over_is_one_line_with_its_place(
    car: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, fault: str
) -> None:
    assert init(monkeypatch, car, text) == 2
    err = capsys.readouterr().err
    assert fault in err and err.count("\n") == 1 and not car.exists()


def test_another_template_is_refused(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_config(car.parent, FLAT)
    monkeypatch.setattr("sys.argv", ["trepid", "init", str(car), "--donkeycar", str(path)])
    assert main() == 2
