"""Recordings are read as written, up to the last chunk when cut short, and in older formats."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from foreign_ros_rig import damage_chunk
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid import messages as m
from trepid.config import ROOT, InputError
from trepid.packages import PACKAGES
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording, attachments
from trepid.topics import CAMERA_IMAGE, LEAD_VEHICLE, VEHICLE_STATE, estimate_topic
from trepid.wire import STORE, definition, ros_name, to_cdr

SECONDS = 30
STATE = m.VehicleState(
    t_s=1.0, speed_mps=3.0, road_wheel_angle_rad=None, yaw_rate_radps=0.1, driver_override=False
)
NOTHING = m.SteeringEstimate.nothing(7.0, estimator="cv", lookahead_m=8.0, reason="")


def states() -> list[m.VehicleState]:
    """Ten a second."""
    return [dataclasses.replace(STATE, t_s=100.0 + i / 10, speed_mps=i / 10) for i in range(10 * SECONDS)]


def write_recording(path: Path, *, began_s: float | None = None) -> Path:
    rules = path.parent / "fear.yaml"
    rules.write_text("rules: here\n")
    with Recording(path, attachments(rules)) as recording:
        if began_s is not None:
            recording.began(began_s)
        for state in states():
            recording.add("vehicle/state", to_cdr(state), at_s=state.t_s + 0.01)
            recording.add("foreign/topic", b"anything", at_s=state.t_s + 0.02)
    return path


def foreign(path: Path, key: str, name: str, text: str, *messages: bytes) -> Path:
    """A recording written by another program."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="another")
        schema = writer.register_schema(name, "ros2msg", text.encode())
        channel = writer.register_channel(f"/{key}", "cdr", schema)
        for at_ns, data in enumerate(messages, start=1):
            writer.add_message(channel, at_ns, data, at_ns)
        writer.finish()
    return path


def test_messages_files_and_start_of_a_drive_are_read_as_written(tmp_path: Path) -> None:
    read = read_recording(write_recording(tmp_path / "a.mcap", began_s=103.5), "vehicle/*")
    assert [state for _, state in read.of(VEHICLE_STATE)] == states()
    assert read.of(VEHICLE_STATE)[0][0] == pytest.approx(100.01)
    assert read.files == {"fear.yaml": b"rules: here\n"}
    assert (read.began_s, read.complete) == (103.5, True)
    assert read.last_s == pytest.approx(states()[-1].t_s + 0.02)


def test_only_the_requested_topics_and_times_are_read(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.mcap")
    assert read_recording(path, "perception/*").messages == {}
    short = read_recording(path, VEHICLE_STATE.key, from_s=110.0, to_s=112.0).of(VEHICLE_STATE)
    assert {round(at_s) for at_s, _ in short} == {110, 111, 112}


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9, 0.999])
def test_a_truncated_recording_is_read_up_to_its_last_complete_chunk(tmp_path: Path, share: float) -> None:
    """Power is lost at any byte: the data on the disk is readable up to about the last second."""
    whole = write_recording(tmp_path / "whole.mcap", began_s=100.0).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(share * len(whole))])
    read = read_recording(cut, VEHICLE_STATE.key)
    found = [state for _, state in read.of(VEHICLE_STATE)]
    assert not read.complete
    assert found == states()[: len(found)]
    assert len(found) >= (share - 0.1) * len(states())  # the index at the end takes some of the bytes


def test_every_second_is_on_disk_while_recording(tmp_path: Path) -> None:
    path = tmp_path / "now.mcap"
    with Recording(path) as recording:
        for state in states():
            recording.add("vehicle/state", to_cdr(state), at_s=state.t_s)
            if state.t_s > 105.0:
                there = read_recording(path, VEHICLE_STATE.key)
                assert there.last_s > state.t_s - 1.2
                assert not there.complete
            if state.t_s > 107.0:
                break


def lost_states(path: Path) -> list[m.VehicleState]:
    """The states that reading ``path`` misses; the others are as written, and the missing ones are counted."""
    read = read_recording(path, VEHICLE_STATE.key)
    found = [state for _, state in read.of(VEHICLE_STATE)]
    lost = [state for state in states() if state not in found]
    assert found == [state for state in states() if state not in lost]
    assert read.complete and sum(read.lost.values()) in (len(lost), 0)
    return lost


@pytest.mark.parametrize("number", [0, 1, 20, -1])
def test_a_corrupted_chunk_costs_its_messages_alone_which_are_counted_and_said_once(
    tmp_path: Path, number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also the first one, which holds the only definition of the channel before the summary."""
    path = write_recording(tmp_path / "a.mcap")
    damage_chunk(path, number)
    lost = lost_states(path)
    assert 1 <= len(lost) <= 4
    assert lost_states(path) == lost
    said = [line for line in capsys.readouterr().err.splitlines() if "corrupted" in line]
    assert len(said) == 1
    assert re.fullmatch(
        r".*a\.mcap: the \d+ bytes from byte \d+ on are corrupted, and the \d+ messages .*", *said
    )


def test_reading_goes_on_at_the_next_chunk_behind_a_corrupted_length(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.mcap")
    begin = sorted(chunk.chunk_start_offset for chunk in chunks_of(path, f"/{VEHICLE_STATE.key}"))[5]
    data = bytearray(path.read_bytes())
    data[begin + 7] ^= 0xFF  # one of the highest bytes
    path.write_bytes(data)
    assert 1 <= len(lost_states(path)) <= 4


def test_messages_whose_channel_was_lost_with_the_summary_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_recording(tmp_path / "a.mcap")
    begins = sorted(chunk.chunk_start_offset for chunk in chunks_of(path, f"/{VEHICLE_STATE.key}"))
    damage_chunk(path, 0)
    path.write_bytes(path.read_bytes()[: begins[3]])
    read = read_recording(path, VEHICLE_STATE.key)
    assert not read.complete and not read.of(VEHICLE_STATE) and sum(read.lost.values()) > 4
    assert "messages of channels that no readable part defines are lost" in capsys.readouterr().err


def with_raw_images(path: Path) -> Path:
    """A state, then images and states in turn."""
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    with Recording(path) as recording:
        for state in states()[:20]:
            recording.add("vehicle/state", to_cdr(state), at_s=state.t_s)
            image = m.Frame(t_s=state.t_s, image=pixels)
            recording.add("camera/image", to_cdr(image), at_s=state.t_s + 0.05)
    return path


def chunks_of(path: Path, channel: str) -> list[ChunkIndex]:
    """The chunks with a message on ``channel``."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    ids = {number for number, one in summary.channels.items() if one.topic == channel}
    return [chunk for chunk in summary.chunk_indexes if ids & chunk.message_index_offsets.keys()]


def test_each_raw_image_is_a_chunk_of_its_own_that_a_reader_of_other_topics_steps_over(
    tmp_path: Path,
) -> None:
    path = with_raw_images(tmp_path / "raw.mcap")
    chunks = chunks_of(path, "/camera/image")
    assert len(chunks) == 20 and all(len(chunk.message_index_offsets) == 1 for chunk in chunks)
    whole = read_recording(path, CAMERA_IMAGE.key, VEHICLE_STATE.key)
    assert [state for _, state in whole.of(VEHICLE_STATE)] == states()[:20]
    assert [frame.t_s for _, frame in whole.of(CAMERA_IMAGE)] == [state.t_s for state in states()[:20]]

    broken = bytearray(path.read_bytes())  # the images but for the first, which defines their channel
    for chunk in chunks[1:]:
        middle = chunk.chunk_start_offset + chunk.chunk_length // 2
        broken[middle] ^= 0xFF
    path.write_bytes(broken)
    read = read_recording(path, VEHICLE_STATE.key)
    assert [state for _, state in read.of(VEHICLE_STATE)] == states()[:20] and read.complete
    assert (read.first_s, read.last_s) == pytest.approx((whole.first_s, whole.last_s))
    assert len(read_recording(path, CAMERA_IMAGE.key).of(CAMERA_IMAGE)) == 1


def test_a_message_that_was_malformed_on_the_bus_is_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Recording(path) as recording:
        recording.add("vehicle/state", to_cdr(states()[0]), at_s=1.0)
        recording.add("vehicle/state", b"junk", at_s=2.0)
        recording.add("vehicle/state", to_cdr(states()[1]), at_s=3.0)
    read = read_recording(path, VEHICLE_STATE.key)
    assert [state for _, state in read.of(VEHICLE_STATE)] == states()[:2]
    assert read.malformed == {"vehicle/state": 1}
    assert read.complete


@pytest.mark.parametrize("data", [b"", b"hello", b"\x89MCAP0\r\n", bytes(1000)])
def test_an_error_names_a_file_that_is_no_recording(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"no\.mcap: not a recording"):
        read_recording(path, "*")
    with pytest.raises(InputError, match=r"gone\.mcap: cannot be read"):
        read_recording(tmp_path / "gone.mcap", "*")


@pytest.mark.parametrize("older", [False, True])
def test_two_channels_of_a_topic_are_read_together_unless_their_definitions_differ(
    tmp_path: Path, older: bool
) -> None:
    """As in a recording that was joined from two by another program."""
    path, name = tmp_path / "joined.mcap", ros_name(m.VehicleState)
    text = definition(m.VehicleState)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="another")
        for number, state in enumerate(states()[:2], start=1):
            changed = text.replace("float64 yaw_rate_radps\n", "") if older and number == 2 else text
            schema = writer.register_schema(name, "ros2msg", changed.encode())
            channel = writer.register_channel(f"/{VEHICLE_STATE.key}", "cdr", schema)
            writer.add_message(channel, number, to_cdr(state), number)
        writer.finish()
    if older:
        with pytest.raises(InputError, match=r"joined\.mcap: vehicle/state has messages of two definitions"):
            read_recording(path, VEHICLE_STATE.key)
    else:
        read = read_recording(path, VEHICLE_STATE.key)
        assert [state for _, state in read.of(VEHICLE_STATE)] == states()[:2]


def test_fields_that_an_older_version_lacks_are_absent(tmp_path: Path) -> None:
    text = (
        "std_msgs/Header header\nfloat64 distance_m\nfloat64 confidence\n"
        + definition(m.LeadVehicle)[definition(m.LeadVehicle).index("====") :]
    )
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, ros_name(m.LeadVehicle)))
    time = store.types["builtin_interfaces/msg/Time"](sec=7, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    older = store.types[ros_name(m.LeadVehicle)](header=header, distance_m=20.0, confidence=0.5)
    data = bytes(store.serialize_cdr(older, ros_name(m.LeadVehicle)))
    path = foreign(tmp_path / "old.mcap", LEAD_VEHICLE.key, ros_name(m.LeadVehicle), text, data)
    ((_, lead),) = read_recording(path, "perception/*").of(LEAD_VEHICLE)
    assert (lead.t_s, lead.distance_m, lead.confidence) == (7.0, 20.0, 0.5)
    assert lead.lateral_m is None and lead.speed_mps is None


def without(line: str) -> tuple[str, bytes]:
    """An older definition of the estimate, without ``line``, and an empty estimate by it."""
    name, now = ros_name(m.SteeringEstimate), definition(m.SteeringEstimate)
    text = now.replace(line, "")
    assert text != now
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    newer = STORE.deserialize_cdr(to_cdr(NOTHING), name)
    kept = {field.name: getattr(newer, field.name) for field in dataclasses.fields(store.types[name])}
    return text, bytes(store.serialize_cdr(store.types[name](**kept), name))


WITHOUT_ESTIMATOR, _ = without("string estimator\n")


@pytest.mark.parametrize("line", ["string kind\n", "float64[] ahead_sigma_m\n", "float64 speed_mps\n"])
def test_an_estimate_recorded_without_a_field_has_its_default(tmp_path: Path, line: str) -> None:
    """Without a kind it is one of the lane; without deviations or a speed it states nothing about them."""
    text, data = without(line)
    path = foreign(tmp_path / "old.mcap", estimate_topic("cv").key, ros_name(m.SteeringEstimate), text, data)
    ((_, read),) = read_recording(path, "perception/*").of(estimate_topic("cv"))
    assert read == NOTHING
    assert (read.kind, read.ahead_sigma_m, read.speed_mps) == (m.EstimateKind.LANE, (), None)


def test_a_malformed_message_of_an_older_version_is_left_out_and_counted(tmp_path: Path) -> None:
    text, data = without("float64[] ahead_sigma_m\n")
    path, key = tmp_path / "old.mcap", estimate_topic("cv").key
    foreign(path, key, ros_name(m.SteeringEstimate), text, data, data[:40], data)
    read = read_recording(path, "perception/*")
    assert [estimate for _, estimate in read.of(estimate_topic("cv"))] == [NOTHING] * 2
    assert read.malformed == {key: 1}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("std_msgs/msg/String", "string data\n", "holds std_msgs/msg/String, expected trepid_msgs"),
        (ros_name(m.SteeringEstimate), "float64", "its definition of .* cannot be read"),
        (ros_name(m.SteeringEstimate), "string data\n", "does not fit this version: it has no field header"),
        (
            ros_name(m.SteeringEstimate),
            WITHOUT_ESTIMATOR,
            "does not fit this version: it has no field estimator",
        ),
    ],
)
def test_an_error_names_a_message_of_another_type(tmp_path: Path, name: str, text: str, message: str) -> None:
    path = foreign(tmp_path / "x.mcap", estimate_topic("cv").key, name, text, b"\x00\x01\x00\x00")
    with pytest.raises(InputError, match=message) as error:
        read_recording(path, "perception/*")
    assert "\n" not in str(error.value)


def test_recordings_are_read_and_written_in_this_room_only() -> None:
    imports = re.compile(r"^\s*(?:from|import) mcap\b", re.MULTILINE)
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    users = {str(path.relative_to(ROOT).parent) for path in files if imports.search(path.read_text("utf-8"))}
    assert users == {"trepid/recording"}
