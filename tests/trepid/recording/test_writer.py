"""Recordings hold the bytes of the bus and open without Trepid."""

import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.bus import Bus, free_endpoint, open_bus
from trepid.config import InputError
from trepid.messages import Command, VehicleState
from trepid.recording.writer import BusRecorder
from trepid.topics import COMMAND, VEHICLE_STATE, Topic, estimate_topic, topic_of
from trepid.wire import to_cdr

STATE = VehicleState(
    t_s=12.5, speed_mps=3.0, road_wheel_angle_rad=None, yaw_rate_radps=0.1, driver_override=False
)
COMMAND_SENT = Command(
    t_s=12.0, road_wheel_angle_rad=0.25, road_wheel_rate_radps=0, speed_mps=3, accel_mps2=0.5, jerk_mps3=0
)


def record(path: Path, *, patience_s: float = 5) -> None:
    """Record a state and a command sent over a bus into ``path``."""
    endpoint = free_endpoint()
    with (
        open_bus("car", time.monotonic, listen=endpoint) as launcher,
        open_bus("car", time.monotonic, connect=endpoint) as vehicle,
        BusRecorder(path, launcher) as recording,
    ):
        received = launcher.latest(VEHICLE_STATE)
        send_state, send_command = vehicle.publisher(VEHICLE_STATE), vehicle.publisher(COMMAND)
        deadline_s = time.monotonic() + patience_s
        while received.take() is None and time.monotonic() < deadline_s:
            send_state(STATE)
            time.sleep(0.02)
        send_command(COMMAND_SENT)
        commands = launcher.latest(COMMAND)
        while commands.take() is None and time.monotonic() < deadline_s:
            send_command(COMMAND_SENT)
            time.sleep(0.02)
        recording.write()


def test_a_recording_holds_the_bytes_of_the_bus(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path)
    with path.open("rb") as file:
        found = {channel.topic: message.data for _, channel, message in make_reader(file).iter_messages()}
    assert found == {"/vehicle/state": to_cdr(STATE), "/controller/command": to_cdr(COMMAND_SENT)}


def test_a_recording_contains_its_own_message_definitions(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path)
    store = get_typestore(Stores.EMPTY)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            store.register(get_types_from_msg(schema.data.decode(), schema.name))
            decoded = store.deserialize_cdr(message.data, schema.name)
            if channel.topic == "/controller/command":
                assert decoded.drive.steering_angle == 0.25


def test_a_recording_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "no_such_folder" / "drive.mcap"
    with (
        open_bus("car", time.monotonic, listen=free_endpoint()) as bus,
        pytest.raises(InputError, match=r"drive\.mcap: cannot be written"),
    ):
        BusRecorder(path, bus)


def test_a_key_leads_to_its_topic_and_a_foreign_one_to_none(tmp_path: Path) -> None:
    assert topic_of("controller/command") == COMMAND
    assert topic_of("perception/cnn/estimate") == estimate_topic("cnn")
    assert topic_of("perception/cnn") is None


def test_the_bus_prefix_is_not_part_of_the_key() -> None:
    endpoint = free_endpoint()
    with (
        open_bus("car", time.monotonic, listen=endpoint) as one,
        open_bus("car", time.monotonic, connect=endpoint) as other,
    ):
        tap = one.tap("**")
        assert heard_key(tap, other, VEHICLE_STATE) == "vehicle/state"


def heard_key(tap: object, bus: Bus, topic: Topic[VehicleState], *, patience_s: float = 5) -> str | None:
    send = bus.publisher(topic)
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        send(STATE)
        time.sleep(0.02)
        for key, _, _ in tap.drain():
            return key
    return None
