"""config/actuator.yaml: the chosen actuator, and its faults with their places."""

import can_rig
import pytest

from trepid.config import InputError, use_car
from vehicle.actuators import table
from vehicle.actuators.actuator import Car
from vehicle.actuators.can.settings import CanSettings

CAR = Car(can_rig.VEHICLE, None, lambda: 0.0)


@pytest.fixture
def car(tmp_path, monkeypatch):
    monkeypatch.setenv("TREPID_CAR", "")

    def write(text):
        (tmp_path / "actuator.yaml").write_text(text)
        use_car(tmp_path)

    yield write
    use_car(None)


def test_the_default_is_the_simulated_car_which_is_a_process_of_its_own():
    assert table.configured_actuator() == ("sim", None)
    with pytest.raises(
        InputError, match=r"actuator.yaml:5:1: actuator: 'sim' is the car of the process sim_harness"
    ):
        table.build(CAR)


def test_a_car_overrides_single_fields_of_the_block(car):
    car("actuator: can\ncan: {channel: can7}\n")
    name, settings = table.configured_actuator()
    assert name == "can"
    assert isinstance(settings, CanSettings)
    assert (settings.interface, settings.channel) == ("socketcan", "can7")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("actuator: cann\n", "actuator.yaml:1:1: actuator: unknown actuator 'cann'; did you mean 'can'?"),
        ("actuater: can\n", "actuator.yaml:1:1: unknown actuator 'actuater'; did you mean 'actuator'?"),
        (
            "actuator: can\ncan:\n  chanel: can1\n",
            "actuator.yaml:3:3: unknown field 'can.chanel'; did you mean",
        ),
        (
            "actuator: can\ncan:\n  map: none.yaml\n",
            "actuator.yaml:1:1: can: map: no such file none.yaml; its place is",
        ),
        ("actuator: ackermann\nackermann: {state: odometry}\n", "an odometry reports no wheel angle"),
        ("actuator: ackermann\nackermann: {command_topic: controller/command}\n", "is a topic of Trepid"),
        (
            "actuator: ackermann\nackermann: {timeout_s: 0}\n",
            "ackermann.timeout_s: Input should be greater than 0",
        ),
    ],
)
def test_a_fault_is_one_line_with_its_place(car, text, message):
    car(text)
    with pytest.raises(InputError) as refused:
        table.build(CAR)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_missing_library_is_one_line_with_the_remedy(car, monkeypatch):
    car("actuator: can\n")
    monkeypatch.setattr(table, "OWN", {**table.OWN, "can": "no_such_library.can:CanActuator"})
    with pytest.raises(InputError, match=r"needs the package no_such_library: pip install 'trepid\[can\]'"):
        table.configured_actuator()


def test_an_actuator_of_another_package_is_found_by_its_entry_point(car, monkeypatch):
    car("actuator: theirs\ntheirs: {interface: x, channel: y, map: z}\n")
    point = type("Point", (), {"value": "x", "load": lambda self: table.resolve_name(table.OWN["can"])})()
    monkeypatch.setattr(table.plugins, "added_entry_points", lambda group: {"theirs": point})
    name, settings = table.configured_actuator()
    assert (name, settings.channel) == ("theirs", "y")
