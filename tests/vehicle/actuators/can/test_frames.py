"""Frames of the map against opendbc's packer and parser, and their checks on arrival."""

import math
import shutil

import can_rig
import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st
from opendbc.can.packer import CANPacker
from opendbc.can.parser import CANParser

from vehicle.actuators.can.quantities import of_state, to_command, to_state

MAP = can_rig.SHUTTLE
STEERING, ACCELERATION = MAP.settings.commands
SENSOR, SPEED, YAW = MAP.settings.reports
DEG = 180 / math.pi
# Between the values of the signals but for their middles, which opendbc and cantools round differently.
ANGLE_RAD = st.builds(
    lambda raw, part: (raw + part) * 0.0573 / DEG / can_rig.RATIO,
    st.integers(-8700, 8700),
    st.floats(-0.49, 0.49),
)
ACCEL_MPS2 = st.builds(
    lambda raw, part: (raw + part) * 0.001, st.integers(-3999, 1499), st.floats(-0.49, 0.49)
)


@pytest.fixture(scope="module")
def oracle(tmp_path_factory):
    """Our DBC under a name for which opendbc computes Toyota's checksum."""
    path = tmp_path_factory.mktemp("opendbc") / "toyota_shuttle.dbc"
    shutil.copy(can_rig.FOLDER / "shuttle.dbc", path)
    return str(path)


def quantities(angle_rad=0.0, accel_mps2=0.0, t_s=1.0):
    return can_rig.command_quantities(can_rig.command(angle_rad, accel_mps2, t_s=t_s))


@given(angles_rad=st.lists(ANGLE_RAD, min_size=1, max_size=5))
def test_steering_frames_are_the_bytes_of_opendbc(oracle, angles_rad):
    packer, sender = CANPacker(oracle), MAP.sender(STEERING)
    for count, angle_rad in enumerate(angles_rad):
        values = dict(
            SETME_X1=1, SETME_X3=1, PERCENTAGE=100, STEER_REQUEST=1, STEER_REQUEST_2=1, COUNTER=count
        )
        values["STEER_ANGLE_CMD"] = angle_rad * can_rig.RATIO * DEG
        address, data, _ = packer.make_can_msg("STEERING_LTA", 0, values)
        assert (sender.address, sender.frame(quantities(angle_rad))) == (address, data)


@given(accel_mps2=ACCEL_MPS2)
def test_acceleration_frames_are_the_bytes_of_opendbc(oracle, accel_mps2):
    values = dict(ACCEL_CMD=accel_mps2, PERMIT_BRAKING=1, ENGAGED=1)
    address, data, _ = CANPacker(oracle).make_can_msg("ACC_CONTROL", 0, values)
    sender = MAP.sender(ACCELERATION)
    assert (sender.address, sender.frame(quantities(accel_mps2=accel_mps2))) == (address, data)


def test_steering_of_the_shuttle_is_that_of_a_rav4_in_opendbc():
    """The layout that opendbc has for Toyota's angle steering gives the same bytes."""
    values = dict(SETME_X1=1, SETME_X3=1, PERCENTAGE=100, STEER_REQUEST=1, STEER_REQUEST_2=1, COUNTER=0)
    values["STEER_ANGLE_CMD"] = 0.2 * can_rig.RATIO * DEG
    expected = CANPacker("toyota_nodsu_pt_generated").make_can_msg("STEERING_LTA", 0, values)
    sender = MAP.sender(STEERING)
    assert (sender.address, sender.frame(quantities(0.2))) == expected[:2]


@given(angle_rad=ANGLE_RAD, torque_nm=st.floats(-10, 10), override=st.booleans())
def test_reports_that_opendbc_packs_are_read(oracle, angle_rad, torque_nm, override):
    values = dict(STEER_ANGLE=angle_rad * can_rig.RATIO * DEG, STEER_TORQUE_DRIVER=torque_nm)
    values |= dict(STEER_OVERRIDE=override)
    _, data, _ = CANPacker(oracle).make_can_msg("STEER_TORQUE_SENSOR", 0, values)
    found = to_state(MAP.receiver(SENSOR).quantities(data), steering_ratio=can_rig.RATIO, t_s=0.0)
    assert found.road_wheel_angle_rad == pytest.approx(angle_rad, abs=0.0573 / DEG / can_rig.RATIO / 1.9)
    assert found.driver_torque_nm == pytest.approx(torque_nm, abs=0.0051)
    assert found.driver_override is override


@given(angle_rad=ANGLE_RAD, accel_mps2=ACCEL_MPS2)
def test_opendbc_reads_what_is_sent(oracle, angle_rad, accel_mps2):
    parser = CANParser(oracle, [("STEERING_LTA", 100), ("ACC_CONTROL", 50)], 0)
    sent = [MAP.sender(each) for each in MAP.settings.commands]
    frames = [(each.address, each.frame(quantities(angle_rad, accel_mps2)), 0) for each in sent]
    parser.update([(1, frames)])
    assert parser.vl["STEERING_LTA"]["STEER_ANGLE_CMD"] == pytest.approx(
        angle_rad * can_rig.RATIO * DEG, abs=0.03
    )
    assert parser.vl["ACC_CONTROL"]["ACCEL_CMD"] == pytest.approx(accel_mps2, abs=0.00051)


@given(angle_rad=ANGLE_RAD, accel_mps2=ACCEL_MPS2, engaged=st.booleans())
def test_a_command_comes_through_the_wire_within_the_resolution_of_its_signals(
    angle_rad, accel_mps2, engaged
):
    sent = quantities(angle_rad, accel_mps2, t_s=1.0 if engaged else None)
    found = {}
    for each in MAP.settings.commands:
        found |= MAP.receiver(each).quantities(MAP.sender(each).frame(sent))
    arrived = to_command(found, steering_ratio=can_rig.RATIO, t_s=2.0)
    assert arrived.road_wheel_angle_rad == pytest.approx(angle_rad, abs=0.0573 / DEG / can_rig.RATIO / 1.9)
    assert arrived.accel_mps2 == pytest.approx(accel_mps2, abs=0.00051)
    assert found["engaged"] == engaged


def test_a_state_comes_through_the_wire_within_the_resolution_of_its_signals():
    state = can_rig.state(-0.3, 7.7, 0.4, override=True, torque_nm=-2.5)
    found = {}
    for each in MAP.settings.reports:
        frame = MAP.sender(each).frame(of_state(state, steering_ratio=can_rig.RATIO))
        found |= MAP.receiver(each).quantities(frame)
    arrived = to_state(found, steering_ratio=can_rig.RATIO, t_s=0.0)
    assert arrived.speed_mps == pytest.approx(7.7, abs=0.0015)
    assert arrived.yaw_rate_radps == pytest.approx(0.4, abs=0.0022)
    assert arrived.road_wheel_angle_rad == pytest.approx(-0.3, abs=0.0001)
    assert (arrived.driver_override, arrived.driver_torque_nm) == (True, pytest.approx(-2.5))


@pytest.mark.parametrize("sign", [1, -1])
def test_scale_offset_and_sign_act_as_the_map_says(tmp_path, sign):
    """signal = sign · scale · quantity + offset, as cantools decodes the frame."""
    new = f"quantity: steering_wheel_angle_rad, scale: 50, offset: 10, sign: {sign}}}"
    path = can_rig.copy_map(tmp_path, **{"quantity: steering_wheel_angle_rad, scale: 57.29578}": new})
    signals = can_rig.load_map(path, can_rig.VEHICLE)
    frame = signals.sender(signals.settings.commands[0]).frame(quantities(0.1))
    decoded = cantools.database.load_file(tmp_path / "shuttle.dbc").decode_message("STEERING_LTA", frame)
    assert decoded["STEER_ANGLE_CMD"] == pytest.approx(sign * 50 * 0.1 * can_rig.RATIO + 10, abs=0.03)
    received = signals.receiver(signals.settings.commands[0]).quantities(frame)
    assert received["steering_wheel_angle_rad"] == pytest.approx(0.1 * can_rig.RATIO, abs=0.001)


def frames(count):
    sender = MAP.sender(STEERING)
    return [sender.frame(quantities()) for _ in range(count)]


@pytest.mark.parametrize("bit", range(64))
def test_a_frame_with_one_wrong_bit_is_refused(bit):
    (frame,) = frames(1)
    wrong = (int.from_bytes(frame, "big") ^ (1 << bit)).to_bytes(8, "big")
    receiver = MAP.receiver(STEERING)
    assert receiver.quantities(wrong) is None
    assert receiver.refused == {"checksum": 1}


def test_a_frame_of_another_length_is_refused():
    receiver = MAP.receiver(STEERING)
    assert receiver.quantities(frames(1)[0][:7]) is None
    assert receiver.refused == {"length": 1}


def test_a_repeated_frame_is_refused_and_lost_ones_are_not():
    sent, receiver = frames(70), MAP.receiver(STEERING)
    assert receiver.quantities(sent[0]) is not None
    assert receiver.quantities(sent[3]) is not None  # two lost
    assert receiver.quantities(sent[3]) is None  # repeated


@pytest.mark.parametrize("wrong", [10, 14, 7])  # repeated, three lost, backwards
def test_after_a_wrong_counter_a_message_counts_from_the_third_right_one_on(wrong):
    sent, receiver = frames(30), MAP.receiver(STEERING)
    assert receiver.quantities(sent[10]) is not None
    following = [receiver.quantities(frame) is not None for frame in sent[wrong : wrong + 5]]
    assert following == [False, False, False, True, True]
    assert receiver.refused == {"counter": 3}


def test_of_two_senders_with_one_address_neither_is_heard():
    one, other, receiver = frames(60), frames(60)[30:], MAP.receiver(STEERING)
    receiver.quantities(one[0])
    heard = [receiver.quantities(frame) for pair in zip(one[1:], other, strict=False) for frame in pair]
    assert sum(each is not None for each in heard) == 1  # the first right one


def test_the_counter_passes_its_end():
    sent, receiver = frames(130), MAP.receiver(STEERING)
    assert all(receiver.quantities(frame) is not None for frame in sent)


def test_a_counter_that_stands_still_is_refused_for_ever():
    (frame,), receiver = frames(1), MAP.receiver(STEERING)
    assert [receiver.quantities(frame) is not None for _ in range(20)] == [True] + [False] * 19


def test_a_value_beyond_its_signal_is_sent_as_the_largest(oracle):
    frame = MAP.sender(ACCELERATION).frame(quantities(accel_mps2=1e6))
    assert MAP.receiver(ACCELERATION).quantities(frame)["accel_mps2"] == pytest.approx(20.0)
