"""A map of signals that does not fit its DBC is refused with its place."""

import can_rig
import pytest

from trepid.config import InputError

FAULTS = {
    "message: STEERING_LTA": (
        "message: STEERING_LTE",
        "map.yaml:8:5: commands.0.message: the DBC has no message 'STEERING_LTE'; did you mean 'STEERING_LTA'?",
    ),
    "{signal: STEER_ANGLE_CMD,": (
        "{signal: STEER_ANGEL_CMD,",
        "map.yaml:11:10: commands.0.signals.0.signal: STEERING_LTA has no signal 'STEER_ANGEL_CMD'; "
        "did you mean 'STEER_ANGLE_CMD'?",
    ),
    "steering_wheel_angle_rad, scale: 57.29578}": (
        "steering_wheel_angle_rad, scale: 100}",
        "map.yaml:11:10: commands.0.signals.0.signal: signal 'STEER_ANGLE_CMD' holds -540 to 540 deg, "
        "-880 to 880 is needed",
    ),
    "PERCENTAGE: 100": ("PERCENTAGE: 256", "signal 'PERCENTAGE' holds 0 to 255 %, 256 is needed"),
    "SETME_X1: 1": ("SETME_X9: 1", "STEERING_LTA has no signal 'SETME_X9'; did you mean"),
    "counter: {signal: COUNTER}": (
        "counter: {signal: COUNT}",
        "map.yaml:15:15: commands.0.counter.signal: STEERING_LTA has no signal 'COUNT'; did you mean 'COUNTER'?",
    ),
    "checksum: {signal: CHECKSUM, algorithm: toyota}": (
        "checksum: {signal: CHECKSUM, algorithm: toyotta}",
        "map.yaml:16:34: commands.0.checksum.algorithm: unknown value 'toyotta'; did you mean 'toyota'?",
    ),
    "{signal: COUNTER}": ("{signal: CHECKSUM}", "signal 'CHECKSUM' is used twice"),
    "quantity: accel_mps2": (
        "quantity: accel",
        "commands.1.signals.0.quantity: unknown value 'accel'; did you mean 'accel_mps2'?",
    ),
    "{signal: CHECKSUM, algorithm: toyota}": (
        "{signal: COUNTER, algorithm: crc8_j1850}",
        "signal 'COUNTER' is used twice",
    ),
    "message: SPEED": ("message: STEER_TORQUE_SENSOR", "'STEER_TORQUE_SENSOR' has an entry already"),
    "period_s: 0.01 ": (
        "period_s: 0.005 ",
        "commands.0.period_s: Input should be greater than or equal to 0.01",
    ),
    "timeout_s: 0.1": ("timeout: 0.1", "unknown field 'reports.0.timeout'; did you mean 'timeout_s'?"),
    "quantity: speed_mps": ("quantity: yaw_rate_radps", "reports: no signal has the quantity speed_mps"),
    "safe_accel_mps2: -2.0": (
        "safe_accel_mps2: -20.0",
        "map.yaml:5:1: safe_accel_mps2: Input should be greater than or equal to -4",
    ),
    "dbc: shuttle.dbc": ("dbc: shuttel.dbc", "map.yaml:4:1: dbc:"),
}


@pytest.mark.parametrize("old", FAULTS)
def test_a_map_that_does_not_fit_is_refused_with_its_place_and_the_nearest_name(tmp_path, old):
    new, message = FAULTS[old]
    path = can_rig.copy_map(tmp_path, **{old: new})
    with pytest.raises(InputError) as refused:
        can_rig.load_map(path, can_rig.VEHICLE)
    assert str(tmp_path) in str(refused.value)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_map_whose_signal_holds_too_little_for_this_car_is_refused(tmp_path):
    wide = can_rig.VEHICLE.model_copy(update={"max_road_wheel_angle_rad": 0.7})
    with pytest.raises(InputError, match=r"holds -540 to 540 deg, -641\.7.* to 641\.7.* is needed"):
        can_rig.load_map(can_rig.copy_map(tmp_path), wide)


@pytest.mark.parametrize(
    "text", ["", "BO_ broken", 'BO_ 401 STEERING_LTA: 8 A\n SG_ X : 7|99@0+ (1,0) [0|1] "" B\n']
)
def test_a_file_that_is_no_dbc_or_lacks_the_messages_is_refused_in_one_line(tmp_path, text):
    path = can_rig.copy_map(tmp_path)
    (tmp_path / "shuttle.dbc").write_text(text)
    with pytest.raises(InputError) as refused:
        can_rig.load_map(path, can_rig.VEHICLE)
    assert str(refused.value).startswith(f"{path}:")
    assert "\n" not in str(refused.value)


def test_the_shipped_map_fits_its_dbc():
    names = set(can_rig.SHUTTLE.messages)
    assert names == {"STEERING_LTA", "ACC_CONTROL", "STEER_TORQUE_SENSOR", "SPEED", "KINEMATICS"}
