"""The CAN actuator on python-can's bus inside this process; times are given, nothing waits."""

from pathlib import Path

import can
import can_rig
import pytest
from process_rig import until

from trepid.config import InputError
from vehicle.actuators.actuator import Car
from vehicle.actuators.can.actuator import CanActuator
from vehicle.actuators.can.settings import CanSettings

STEERING, ACCELERATION = 401, 835


@pytest.fixture
def one():
    rig = can_rig.OneBus()
    yield rig
    rig.close()


@pytest.fixture
def senders():
    return [can_rig.SHUTTLE.sender(each) for each in can_rig.SHUTTLE.settings.reports]


def decode(message):
    database = can_rig.SHUTTLE.messages
    name = next(name for name, known in database.items() if known.frame_id == message.arbitration_id)
    return database[name].decode(message.data, decode_choices=False)


def test_each_message_is_sent_at_its_period_by_the_calls_of_write_alone(one):
    for k in range(100):
        one.actuator.write(can_rig.command(), now_s=50.0 + 0.01 * k)
    addresses = [message.arbitration_id for message in one.drain_frames()]
    assert (addresses.count(STEERING), addresses.count(ACCELERATION)) == (100, 50)


def test_jitter_of_the_calls_loses_no_message(one):
    for k in range(100):
        one.actuator.write(can_rig.command(), now_s=50.0 + 0.01 * k + (0.004 if k % 3 else -0.004))
    assert [message.arbitration_id for message in one.drain_frames()].count(STEERING) == 100


def test_a_pause_is_not_made_up_for_by_a_burst(one):
    for now_s in (50.0, 60.0, 60.01):
        one.actuator.write(can_rig.command(), now_s=now_s)
    assert [message.arbitration_id for message in one.drain_frames()].count(STEERING) == 3


def test_a_command_without_a_frame_is_not_engaged(one):
    one.actuator.write(can_rig.command(t_s=None), now_s=1.0)
    one.actuator.write(can_rig.command(t_s=0.9), now_s=1.02)
    steering = [decode(message) for message in one.drain_frames() if message.arbitration_id == STEERING]
    assert [values["STEER_REQUEST"] for values in steering] == [0, 1]


def test_a_later_command_without_a_frame_brakes_an_engaged_car(one):
    """So the limiter stops a car whose driver has released the dead man's switch."""
    one.actuator.write(can_rig.command(t_s=0.9), now_s=1.0)
    one.actuator.write(can_rig.command(0.1, -3.5, t_s=None), now_s=1.02)
    acceleration = [
        decode(message) for message in one.drain_frames() if message.arbitration_id == ACCELERATION
    ]
    assert (acceleration[-1]["ENGAGED"], acceleration[-1]["ACCEL_CMD"]) == (1, -3.5)


def test_the_end_of_an_actuator_that_has_sent_nothing_sends_nothing(one):
    """`trepid doctor` opens and closes it, perhaps beside a running drive."""
    one.actuator.read(now_s=1.0)
    one.actuator.close()
    assert one.drain_frames() == []


def test_the_end_sends_the_safe_state_at_the_last_angle_three_times(one):
    one.actuator.write(can_rig.command(0.2, 1.0), now_s=1.0)
    one.drain_frames()
    one.actuator.close()
    values = [decode(message) for message in one.drain_frames()]
    steering, acceleration = values[0::2], values[1::2]
    assert len(steering) == len(acceleration) == 3
    assert {each["STEER_REQUEST"] for each in steering} == {0}
    assert steering[0]["STEER_ANGLE_CMD"] == pytest.approx(0.2 * 16 * 57.29578, abs=0.03)
    assert {(each["ENGAGED"], each["ACCEL_CMD"]) for each in acceleration} == {(0, -2.0)}
    assert [each["COUNTER"] for each in steering] == [1, 2, 3]


def test_there_is_no_state_before_every_essential_report(one, senders):
    assert one.actuator.read(now_s=1.0) is None
    one.report(can_rig.state(0.1, 5.0), senders[:1])  # angle and override, no speed
    assert one.actuator.read(now_s=1.0) is None
    one.report(can_rig.state(0.1, 5.0), senders[1:2])
    state = one.actuator.read(now_s=1.01)
    assert state.speed_mps == pytest.approx(5.0, abs=0.01)
    assert state.yaw_rate_radps is None  # not reported yet


def test_the_state_has_the_time_of_its_oldest_report(one, senders):
    one.report(can_rig.state(), senders)
    one.actuator.read(now_s=1.0)
    one.report(can_rig.state(), senders[1:])
    assert one.actuator.read(now_s=1.05).t_s == 1.0


@pytest.mark.parametrize("silent", [0, 1])
def test_silence_of_an_essential_report_beyond_its_timeout_is_no_state(one, senders, silent):
    one.report(can_rig.state(), senders)
    assert one.actuator.read(now_s=1.0) is not None
    others = [sender for k, sender in enumerate(senders) if k != silent]
    for now_s in (1.05, 1.099):
        one.report(can_rig.state(), others)
        assert one.actuator.read(now_s=now_s) is not None
    one.report(can_rig.state(), others)
    assert one.actuator.read(now_s=1.101) is None


def test_silence_of_the_yaw_rate_makes_the_yaw_rate_absent(one, senders):
    one.report(can_rig.state(yaw_rate_radps=0.5), senders)
    assert one.actuator.read(now_s=1.0).yaw_rate_radps == pytest.approx(0.5, abs=0.005)
    for now_s in (1.05, 1.15):
        one.report(can_rig.state(yaw_rate_radps=0.5), senders[:2])
        state = one.actuator.read(now_s=now_s)
    assert (state.yaw_rate_radps, state.speed_mps) == (None, 0.0)


def test_a_report_with_a_wrong_checksum_or_a_repeated_counter_does_not_renew_the_state(one, senders):
    one.report(can_rig.state(), senders)
    one.actuator.read(now_s=1.0)
    sensor = senders[0].frame(can_rig.report_quantities(can_rig.state()))
    one.put(senders[0].address, sensor[:-1] + bytes([sensor[-1] ^ 1]))
    one.actuator.read(now_s=1.05)
    assert one.actuator.values() == (("refused STEER_TORQUE_SENSOR checksum", "1"),)
    assert one.actuator.read(now_s=1.09).t_s == 1.0


def test_frames_that_waited_through_a_pause_are_dropped(one, senders):
    """Their age is not known: they may be as old as the pause."""
    one.report(can_rig.state(speed_mps=3.0), senders)
    one.actuator.read(now_s=1.0)
    one.report(can_rig.state(speed_mps=9.0), senders)
    assert one.actuator.read(now_s=3.0) is None
    one.report(can_rig.state(speed_mps=4.0), senders)
    assert one.actuator.read(now_s=3.01).speed_mps == pytest.approx(4.0, abs=0.01)


@pytest.fixture
def with_more_of_the_driver(tmp_path, request):
    """A map whose message of the yaw rate carries a quantity of the driver instead."""
    old = "quantity: yaw_rate_radps, scale: 57.29578"
    rig = can_rig.OneBus(can_rig.copy_map(tmp_path, **{old: f"quantity: {request.param}"}))
    yield rig
    rig.close()


@pytest.mark.parametrize("with_more_of_the_driver", ["driver_override, offset: -125"], indirect=True)
@pytest.mark.parametrize("first", [True, False])
def test_an_override_in_one_of_several_messages_is_an_override(with_more_of_the_driver, senders, first):
    rig = with_more_of_the_driver
    rig.report(can_rig.state(override=first), senders[:2])
    second = can_rig.SHUTTLE.messages["KINEMATICS"]
    rig.put(second.frame_id, second.encode({"YAW_RATE": 0 if first else 1}, scaling=False))
    assert rig.actuator.read(now_s=1.0).driver_override


@pytest.mark.parametrize("with_more_of_the_driver", ["driver_torque_nm"], indirect=True)
def test_silence_of_the_torque_of_the_driver_is_no_state(with_more_of_the_driver, senders):
    rig = with_more_of_the_driver
    rig.report(can_rig.state(), senders)
    assert rig.actuator.read(now_s=1.0) is not None
    rig.report(can_rig.state(), senders[:2])
    assert rig.actuator.read(now_s=1.09) is not None
    rig.report(can_rig.state(), senders[:2])
    assert rig.actuator.read(now_s=1.18) is None


def test_the_driver_is_read_back(one, senders):
    one.report(can_rig.state(override=True, torque_nm=-4.0), senders)
    state = one.actuator.read(now_s=1.0)
    assert (state.driver_override, state.driver_torque_nm) == (True, pytest.approx(-4.0))


def test_frames_of_others_on_the_bus_do_not_count(one):
    one.put(0x123, bytes(8))
    assert one.actuator.read(now_s=1.0) is None
    assert one.actuator.values() == ()


def test_bus_off_is_a_failure_of_the_wire(one, monkeypatch):
    frame = can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8))
    monkeypatch.setattr(one.actuator._wire._bus, "recv", lambda timeout: frame)
    with pytest.raises(OSError, match="bus off"):
        one.actuator.read(now_s=1.0)


@pytest.mark.parametrize("error", [can.CanOperationError("no buffer space"), OSError(100, "Network is down")])
def test_a_refused_frame_is_a_failure_of_the_wire_and_the_other_messages_are_tried(one, monkeypatch, error):
    tried = []

    def refuse(message, timeout):
        tried.append(message.arbitration_id)
        raise error

    monkeypatch.setattr(one.actuator._wire._bus, "send", refuse)
    with pytest.raises(OSError, match="sending failed"):
        one.actuator.write(can_rig.command(), now_s=1.0)
    assert tried == [STEERING, ACCELERATION]
    monkeypatch.undo()


def test_a_refused_frame_does_not_keep_the_safe_state_from_being_sent_again(one, monkeypatch):
    send, refusals = one.actuator._wire._bus.send, iter([OSError(105, "No buffer space available")])

    def refuse_once(message, timeout):
        for refusal in refusals:
            raise refusal
        send(message, timeout)

    one.actuator.write(can_rig.command(), now_s=1.0)
    one.drain_frames()
    monkeypatch.setattr(one.actuator._wire._bus, "send", refuse_once)
    one.actuator.close()
    addresses = [message.arbitration_id for message in one.drain_frames()]
    assert (addresses.count(STEERING), addresses.count(ACCELERATION)) == (2, 3)


def test_a_safe_state_that_was_never_sent_is_a_failure_after_all_attempts(one, monkeypatch):
    tried = []

    def refuse(message, timeout):
        tried.append(message.arbitration_id)
        raise OSError(105, "No buffer space available")

    one.actuator.write(can_rig.command(), now_s=1.0)
    monkeypatch.setattr(one.actuator._wire._bus, "send", refuse)
    with pytest.raises(OSError, match="No buffer space"):
        one.actuator.close()
    assert tried == 3 * [STEERING, ACCELERATION]


@pytest.mark.parametrize(
    ("interface", "channel"), [("no_such_interface", "can0"), ("socketcan", "no_such_channel")]
)
def test_a_bus_that_does_not_open_is_one_line_with_the_remedy(interface, channel):
    settings = CanSettings(interface=interface, channel=channel, map=can_rig.FOLDER / "map.yaml")
    with pytest.raises(
        InputError, match=f"interface {interface}, channel {channel}: cannot be opened"
    ) as refused:
        CanActuator(settings, Car(can_rig.VEHICLE, None, lambda: 0.0))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("error", [NameError("name 'canOpenChannel' is not defined"), RuntimeError("a\nb")])
def test_whatever_an_interface_raises_is_one_line_with_the_place(monkeypatch, error):
    def fail(**_):
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    settings = CanSettings(interface="kvaser", channel="0", map=can_rig.FOLDER / "map.yaml")
    with pytest.raises(InputError, match=r"^can: interface kvaser, channel 0: cannot be opened: ") as refused:
        CanActuator(settings, Car(can_rig.VEHICLE, None, lambda: 0.0))
    assert type(error).__name__ in str(refused.value) and "\n" not in str(refused.value)


def test_an_option_of_the_wrong_type_is_one_line():
    options = {"hop_limit": "x", "port": 43199}
    settings = CanSettings(
        interface="udp_multicast", channel="239.74.163.2", options=options, map=can_rig.FOLDER / "map.yaml"
    )
    with pytest.raises(InputError, match=r"interface udp_multicast.*cannot be opened"):
        CanActuator(settings, Car(can_rig.VEHICLE, None, lambda: 0.0))


@pytest.mark.skipif(
    not Path("/sys/class/net/vcan0").exists(), reason="no interface vcan0: `ip link add vcan0 type vcan`"
)
def test_the_same_over_a_virtual_interface_of_the_kernel(senders):
    settings = CanSettings(interface="socketcan", channel="vcan0", map=can_rig.FOLDER / "map.yaml")
    actuator = CanActuator(settings, Car(can_rig.VEHICLE, None, lambda: 0.0))
    end = can.Bus(interface="socketcan", channel="vcan0")
    actuator.write(can_rig.command(), now_s=1.0)
    assert {end.recv(timeout=5).arbitration_id for _ in range(2)} == {STEERING, ACCELERATION}
    for sender in senders:
        data = sender.frame(can_rig.report_quantities(can_rig.state(speed_mps=3.0)))
        end.send(can.Message(arbitration_id=sender.address, data=data, is_extended_id=False))
    assert until(lambda: actuator.read(now_s=1.0), patience_s=5)
    actuator.close()
    end.shutdown()


def test_frames_of_other_addresses_do_not_hold_back_those_of_the_car(one, senders):
    for speed_mps in (1.0, 2.0, 3.0):
        one.put(0x7FF, b"others")
        one.report(can_rig.state(0.0, speed_mps), senders)
        one.put(0x7FE, b"others")
    assert one.actuator.read(now_s=10.0).speed_mps == pytest.approx(3.0, abs=0.01)
