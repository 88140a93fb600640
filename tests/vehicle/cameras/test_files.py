"""Video files and folders of images as camera sources."""

import shutil
from pathlib import Path

import cv2
import foreign_ros_rig as foreign
import pytest
import zstandard
from camera_source_rig import SIZE, ManualClock, drive, folder_of, number_of, picture, video_of
from image_file_rig import png_of_size
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from trepid.config import InputError, use_car
from trepid.images.files import images_in
from trepid.messages import CompressedFrame
from trepid.recording.foreign import types_of
from trepid.recording.writer import Recording
from trepid.topics import CAMERA_COMPRESSED
from trepid.wire import to_cdr
from vehicle.cameras.files import FolderSettings, ImageFolder, McapFile, McapSettings, VideoFile
from vehicle.cameras.playback import Playback, PlaybackSettings


def numbers(source: Playback) -> list[int]:
    found = []
    while not source.ended:
        frame = source.read(timeout_s=0.0)
        assert frame is not None
        found.append(number_of(frame.image))
    return found


def test_the_images_of_a_folder_come_in_natural_order(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "frames", 12)
    assert [path.name for path in images_in(folder)][:4] == ["0.png", "1.png", "2.png", "3.png"]
    source = ImageFolder(FolderSettings(path=str(folder), pace=0), drive(ManualClock()))
    assert numbers(source) == list(range(12))


def test_a_video_gives_all_frames_at_its_rate(tmp_path: Path) -> None:
    path = video_of(tmp_path / "clip.avi", 6, fps=10.0)
    assert numbers(VideoFile(PlaybackSettings(path=str(path), pace=0), drive(ManualClock()))) == list(
        range(6)
    )
    clock, times_s = ManualClock(), []
    source = VideoFile(PlaybackSettings(path=str(path)), drive(clock))
    while not source.ended:
        frame = source.read(timeout_s=0.0)
        times_s += [frame.t_s] if frame is not None else []
        clock.sleep(0.01)
    assert [t_s - times_s[0] for t_s in times_s] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=1e-3)


def test_a_path_leads_into_the_folder_of_the_car_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TREPID_CAR", raising=False)
    folder_of(tmp_path / "frames", 2)
    use_car(tmp_path)
    source = ImageFolder(FolderSettings(path="frames", pace=0), drive(ManualClock()))
    assert numbers(source) == [0, 1]
    use_car(None)


def test_an_image_of_too_many_pixels_is_reported_and_the_next_one_comes(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "frames", 3)
    (folder / "1.png").write_bytes(png_of_size(60000, 60000))
    source = ImageFolder(FolderSettings(path=str(folder), pace=0), drive(ManualClock()))
    frames = [source.read(timeout_s=0.0) for _ in range(3)]
    assert [None if frame is None else number_of(frame.image) for frame in frames] == [0, None, 2]
    assert ("malformed_images", "1") in source.values()


@pytest.mark.parametrize("kind", ["missing", "text", "empty", "folder"])
def test_an_unreadable_video_is_refused_in_one_line_with_its_name(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    if kind == "text":
        path.write_text("no video")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "folder":
        path.mkdir()
    with pytest.raises(InputError) as problem:
        VideoFile(PlaybackSettings(path=str(path)), drive(ManualClock()))
    assert str(path) in str(problem.value) and "\n" not in str(problem.value)


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "file"])
def test_an_unreadable_folder_is_refused_in_one_line_with_its_name(kind: str, tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    if kind == "file":
        folder.write_text("no folder")
    elif kind != "missing":
        folder.mkdir()
    if kind == "text":
        (folder / "1.png").write_text("no image")
    with pytest.raises(InputError) as problem:
        ImageFolder(FolderSettings(path=str(folder)), drive(ManualClock()))
    assert str(folder) in str(problem.value) and "\n" not in str(problem.value)


SECOND = 10**9
TEXT = "std_msgs/msg/String"
BEGIN_NS = 1_700_000_000 * SECOND


def frames_of(path: Path, topic: str | None = None, pace: float = 1.0) -> list[tuple[float, int]]:
    clock, found = ManualClock(0.0), []
    source = McapFile(McapSettings(path=str(path), topic=topic, pace=pace), drive(clock))
    while not source.ended:
        frame = source.read(timeout_s=0.0)
        found += [(round(frame.t_s, 6), number_of(frame.image))] if frame is not None else []
        clock.sleep(0.01)
    return found


def images(
    count: int, *, late_ns: int = 0, stamped: bool = True, size: tuple[int, int] = SIZE
) -> tuple[str, list[tuple[int, bytes]]]:
    """Ten numbered images a second, logged ``late_ns`` after their stamps, more with each message."""
    times = [BEGIN_NS + n * SECOND // 10 for n in range(count)]
    data = [
        (at + late_ns * n, foreign.image(picture(n, size), "bgr8", stamp_ns=at if stamped else 0))
        for n, at in enumerate(times)
    ]
    return "sensor_msgs/msg/Image", data


def photos(count: int) -> tuple[str, list[tuple[int, bytes]]]:
    times = [BEGIN_NS + n * SECOND // 10 for n in range(count)]
    data = [(at, foreign.compressed_image(picture(n), stamp_ns=at)) for n, at in enumerate(times)]
    return "sensor_msgs/msg/CompressedImage", data


EXPECTED = [(0.0, 0), (0.1, 1), (0.2, 2), (0.3, 3)]


def test_a_foreign_recording_plays_by_the_stamps_of_its_headers(tmp_path: Path) -> None:
    path = foreign.bag(tmp_path / "bag", {"/front/image_raw": images(4, late_ns=30_000_000)})
    assert frames_of(path) == EXPECTED


def test_compressed_images_of_a_foreign_recording_play_too(tmp_path: Path) -> None:
    assert frames_of(foreign.bag(tmp_path / "bag", {"/front/compressed": photos(4)})) == EXPECTED


def test_images_without_stamps_play_by_the_time_of_logging(tmp_path: Path) -> None:
    assert frames_of(foreign.bag(tmp_path / "bag", {"/image": images(4, stamped=False)})) == EXPECTED


def rewritten(source: Path, compression: CompressionType, *, images_a_chunk: int = 1) -> Path:
    """The messages of a recording once more, ``images_a_chunk`` images in a chunk."""
    path = source.with_name("again.mcap")
    with source.open("rb") as old:
        messages = list(make_reader(old).iter_messages())
    schema, channel, first = messages[0]
    chunk_size = int((images_a_chunk - 0.5) * len(first.data))
    with path.open("wb") as new:
        writer = Writer(new, compression=compression, chunk_size=chunk_size)
        writer.start()
        schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
        channel_id = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
        for _, _, message in messages:
            writer.add_message(channel_id, message.log_time, message.data, message.publish_time)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_corrupted_chunk_is_said_and_counted_and_the_frames_after_it_play(
    compression: CompressionType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rewritten(foreign.bag(tmp_path / "bag", {"/image": images(6)}), compression, images_a_chunk=2)
    foreign.damage_chunk(path, 1)
    source = McapFile(McapSettings(path=str(path), pace=0), drive(ManualClock()))
    assert numbers(source) == [0, 1, 4, 5]
    assert ("damaged_parts", "1") in source.values()
    assert "are corrupted, and the 2 messages in them lost" in capsys.readouterr().err


def test_a_recording_cut_short_is_said_and_played_as_far_as_it_can_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rewritten(foreign.bag(tmp_path / "bag", {"/image": images(6)}), CompressionType.NONE)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    source = McapFile(McapSettings(path=str(path), pace=0), drive(ManualClock()))
    found = numbers(source)
    assert found == list(range(len(found))) and 0 < len(found) < 6
    assert "the file is cut short" in capsys.readouterr().err


def test_images_that_are_a_few_places_out_of_order_play_in_order(tmp_path: Path) -> None:
    kind, data = images(6)
    data[1], data[4] = data[4], data[1]
    path = foreign.bag(tmp_path / "bag", {"/image": (kind, data)})
    assert [number for _, number in frames_of(path)] == list(range(6))


def test_images_of_one_stamp_play_by_the_time_of_logging(tmp_path: Path) -> None:
    times = [BEGIN_NS + n * SECOND // 10 for n in range(4)]
    same = [(at, foreign.image(picture(n), "bgr8", stamp_ns=BEGIN_NS)) for n, at in enumerate(times)]
    path = foreign.bag(tmp_path / "bag", {"/image": ("sensor_msgs/msg/Image", same)})
    assert frames_of(path) == EXPECTED


@pytest.mark.parametrize(
    ("kind", "message", "problem"),
    [
        ("Image", foreign.image(picture(0), "32FC1", stamp_ns=BEGIN_NS), "depth or heat"),
        ("Image", foreign.image(picture(0), "h264", stamp_ns=BEGIN_NS), "'h264' of an image; known: bgr8"),
        ("CompressedImage", foreign.compressed_bytes(b"\0\0\0\1\x67", "h264"), "expected one JPEG"),
    ],
)
def test_a_topic_without_a_picture_is_refused_before_the_drive(
    kind: str, message: bytes, problem: str, tmp_path: Path
) -> None:
    data = [(BEGIN_NS + n, message) for n in range(3)]
    path = foreign.bag(tmp_path / "bag", {"/image": (f"sensor_msgs/msg/{kind}", data)})
    with pytest.raises(InputError, match=f"/image: .*{problem}"):
        McapFile(McapSettings(path=str(path)), drive(ManualClock()))


@pytest.mark.parametrize("stamped", [True, False])
def test_malformed_messages_are_counted_and_the_frames_around_them_play(
    stamped: bool, tmp_path: Path
) -> None:
    ros_type, data = images(5, stamped=stamped)
    logged_ns = 86400 * SECOND  # the clock of the recorder is another one
    messages = [(at + logged_ns, message) for at, message in data]
    messages[0] = messages[0][0], b"no message"
    messages[2] = messages[2][0], messages[2][1][:40]
    path = foreign.bag(tmp_path / "bag", {"/image": (ros_type, messages)})
    clock, found = ManualClock(0.0), []
    source = McapFile(McapSettings(path=str(path)), drive(clock))
    while not source.ended:
        frame = source.read(timeout_s=0.0)
        found += [(round(frame.t_s, 6), number_of(frame.image))] if frame is not None else []
        clock.sleep(0.01)
    assert found == [(0.0, 1), (0.2, 3), (0.3, 4)]
    assert ("malformed_images", "1") in source.values()  # the first one has no time


def test_a_recording_of_trepid_plays(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Recording(path) as recording:
        for number in range(4):
            t_s = 1.7e9 + number / 10
            _, jpeg = cv2.imencode(".jpg", picture(number))
            data = to_cdr(CompressedFrame(t_s=t_s, jpeg=jpeg.tobytes()))
            recording.add(CAMERA_COMPRESSED.key, data, at_s=t_s + 0.01)
    assert frames_of(path) == EXPECTED
    assert frames_of(path, "camera/image/compressed") == EXPECTED


def test_one_of_several_topics_with_images_must_be_named(tmp_path: Path) -> None:
    path = foreign.bag(tmp_path / "bag", {"/left/image": images(2), "/right/image": images(3)})
    with pytest.raises(InputError, match="set topic to one of /left/image, /right/image"):
        frames_of(path)
    assert len(frames_of(path, "/right/image")) == 3
    with pytest.raises(InputError, match="did you mean '/right/image'"):
        frames_of(path, "/rigth/image")


def test_a_recording_that_was_cut_short_plays_up_to_its_end(tmp_path: Path) -> None:
    path = foreign.bag(tmp_path / "bag", {"/image": images(8, size=(960, 540))})  # a chunk each
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole))])
    frames = frames_of(path)
    assert [number for _, number in frames] == list(range(len(frames)))
    assert 1 <= len(frames) < 8


@pytest.mark.parametrize("kind", ["missing", "text", "empty", "no images", "folder"])
def test_another_file_is_refused_in_one_line_with_its_name(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    if kind == "text":
        path.write_text("no recording")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "folder":
        path.mkdir()
    elif kind == "no images":
        text = foreign.TYPES["std_msgs/msg/String"](data="hello")
        data = bytes(foreign.STORE.serialize_cdr(text, "std_msgs/msg/String"))
        shutil.copy(foreign.bag(tmp_path / "bag", {"/talk": ("std_msgs/msg/String", [(1, data)])}), path)
    with pytest.raises(InputError) as problem:
        frames_of(path)
    assert str(path) in str(problem.value) and "\n" not in str(problem.value)


def write_images(path: Path, **options: bool) -> Path:
    """A file of the reference writer: four images, behind a topic of text."""
    ros_type, messages = images(4)
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="another")
        said = writer.register_channel(
            "/said", "cdr", writer.register_schema(TEXT, "ros2msg", b"string data")
        )
        writer.add_message(said, BEGIN_NS, b"", BEGIN_NS)
        front = writer.register_channel("/front", "cdr", writer.register_schema(ros_type, "ros2msg", b""))
        for at, data in messages:
            writer.add_message(front, at, data, at)
        writer.finish()
    return path


@pytest.mark.parametrize("option", ["", "use_statistics", "use_chunking"])
@pytest.mark.parametrize("channels", [True, False])
@pytest.mark.parametrize("schemas", [True, False])
def test_a_summary_that_repeats_no_schemas_or_channels_hides_no_image(
    tmp_path: Path, schemas: bool, channels: bool, option: str
) -> None:
    without = {option: False} if option else {}
    path = write_images(tmp_path / "a.mcap", repeat_schemas=schemas, repeat_channels=channels, **without)
    assert types_of(path) == {"/said": TEXT, "/front": "sensor_msgs/msg/Image"}
    assert frames_of(path) == EXPECTED


def write_described(path: Path, name: str, encoding: str) -> Path:
    """A file with images whose type is written as ``name`` and that say to be in ``encoding``."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="another")
        schema = writer.register_schema(name, "ros2msg", b"") if name else 0
        front = writer.register_channel("/front", encoding, schema)
        for at, data in images(4)[1]:
            writer.add_message(front, at, data, at)
        writer.finish()
    return path


@pytest.mark.parametrize("name", ["sensor_msgs/Image", "sensor_msgs::msg::dds_::Image_"])
def test_a_type_is_known_in_the_words_of_ros_1_and_dds(tmp_path: Path, name: str) -> None:
    assert frames_of(write_described(tmp_path / "a.mcap", name, "cdr")) == EXPECTED


@pytest.mark.parametrize(
    ("name", "encoding", "said"),
    [
        ("sensor_msgs/Image", "ros1", "/front (sensor_msgs/Image in ros1)"),
        ("foxglove.CompressedImage", "protobuf", "/front (foxglove.CompressedImage in protobuf)"),
        ("", "cdr", "/front (without a type)"),
    ],
)
def test_a_file_without_usable_images_is_refused_with_what_it_holds(
    tmp_path: Path, name: str, encoding: str, said: str
) -> None:
    with pytest.raises(InputError, match="holds no topic with sensor_msgs/msg/Image") as refused:
        frames_of(write_described(tmp_path / "a.mcap", name, encoding))
    assert str(refused.value).endswith(f"but {said}")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "the file is empty"),
        (b"\x89MCAP0\r\n", "an MCAP file cut short before its first record"),
        (b"#ROSBAG V2.0\n" + bytes(99), "a bag of ROS 1"),
        (b"SQLite format 3\0" + bytes(99), "`ros2 bag convert`"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "`git lfs pull`"),
    ],
)
def test_what_stands_in_place_of_a_recording_is_called_by_its_name(
    tmp_path: Path, data: bytes, said: str
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.mcap: not a recording: ") as refused:
        types_of(path)
    assert said in str(refused.value)


def test_a_chunk_that_was_packed_in_several_frames_is_read_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def in_two_frames(data: bytes) -> bytes:
        half = len(data) // 2
        return pack(data[:half]) + pack(data[half:])

    pack = zstandard.compress
    monkeypatch.setattr("mcap.writer.zstandard.compress", in_two_frames)
    assert frames_of(write_images(tmp_path / "a.mcap")) == EXPECTED
