"""Images, folders of images and videos, read from files."""

import re
from pathlib import Path

import cv2
import foreign_ros_rig as foreign
import numpy as np
import pytest
from video_rig import matroska

from cockpit.footage.sources import Still, is_recording, settings_of, sources
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.files import NOMINAL_FPS, read_image
from trepid.messages import CompressedFrame, Frame
from trepid.recording.writer import Recording
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE
from trepid.wire import to_cdr
from vehicle.cameras.ros_images import IMAGE


def cut(path: Path, share: float) -> Path:
    short = path.with_name(f"cut{path.suffix}")
    data = path.read_bytes()
    short.write_bytes(data[: int(len(data) * share)])
    return short


def bad_inputs(folder: Path, clip: Path) -> dict[str, Path]:
    (folder / "empty").mkdir()
    (folder / "text.jpg").write_text("no image")
    (folder / "zero.png").write_bytes(b"")
    (folder / "notes.txt").write_text("notes")
    (folder / "text.mp4").write_text("no video")
    return {
        "empty folder": folder / "empty",
        "text as image": folder / "text.jpg",
        "empty file": folder / "zero.png",
        "unknown kind": folder / "notes.txt",
        "text as video": folder / "text.mp4",
        "missing": folder / "missing.png",
        "truncated jpeg": cut(folder / "a.jpg", 0.6),
        "truncated png": cut(folder / "b.png", 0.6),
        "truncated video": cut(clip, 0.6),
    }


@pytest.mark.parametrize(
    "kind",
    [
        "empty folder",
        "text as image",
        "empty file",
        "unknown kind",
        "text as video",
        "missing",
        "truncated jpeg",
        "truncated png",
        "truncated video",
    ],
)
def test_bad_input_is_named_in_one_line(kind, folder, clip):
    bad = bad_inputs(folder, clip)[kind]
    with pytest.raises(InputError) as problem:
        for source in sources(bad):
            list(source.read())
    assert str(bad) in str(problem.value) and "\n" not in str(problem.value)


def test_hidden_and_foreign_files_in_a_folder_are_left_out(folder):
    (folder / "readme.txt").write_text("notes")
    found = sources(folder)
    assert all(isinstance(source, Still) for source in found) and len(found) == 2


def test_the_images_of_a_folder_come_in_natural_order(folder):
    for name in ("100.png", "2.png", "frame10.png", "frame9.png"):
        (folder / name).write_bytes((folder / "b.png").read_bytes())
    names = [source.path.name for source in sources(folder)]
    assert names == ["2.png", "100.png", "a.jpg", "b.png", "frame9.png", "frame10.png"]


def record_messages(
    path: Path, *messages: tuple[float, Frame | CompressedFrame], notes: dict[str, str]
) -> Path:
    with Recording(path, {}, notes) as file:
        for at_s, message in messages:
            key = CAMERA_IMAGE.key if isinstance(message, Frame) else CAMERA_COMPRESSED.key
            file.add(key, to_cdr(message), at_s=at_s)
    return path


def photo(grey: int) -> np.ndarray:
    return np.full((24, 32, 3), grey, np.uint8)


def jpeg(grey: int) -> bytes:
    return bytes(cv2.imencode(".jpg", photo(grey))[1])


def test_the_jpeg_images_of_a_recording_are_read_where_there_are_no_raw_ones(tmp_path):
    many = [(10.0 + n, CompressedFrame(t_s=9.9 + n, jpeg=jpeg(40 * n))) for n in range(5)]
    (source,) = sources(record_messages(tmp_path / "jpeg.mcap", *many, notes={"what": "test"}))
    shots = list(source.shots())
    assert [(shot.number, shot.t_s) for shot in shots] == [(n, pytest.approx(9.9 + n)) for n in range(5)]
    assert [int(shot.image.mean()) for shot in shots] == pytest.approx([40 * n for n in range(5)], abs=2)
    assert [int(image.mean()) for image in source.sample(3)] == pytest.approx([0, 80, 160], abs=2)
    both = [*many, (20.0, Frame(t_s=19.9, image=photo(7)))]
    (source,) = sources(record_messages(tmp_path / "both.mcap", *both, notes={}))
    assert [int(shot.image.mean()) for shot in source.shots()] == [7]


def test_the_frame_rate_of_a_recording_is_that_of_its_captures(tmp_path):
    stamps_s = (9.0, 9.1, 9.1, 9.2, 9.7, 9.8)  # one repeated, one pause
    many = [(stamp_s + 0.03, CompressedFrame(t_s=stamp_s, jpeg=jpeg(90))) for stamp_s in stamps_s]
    (source,) = sources(record_messages(tmp_path / "many.mcap", *many, notes={}))
    assert source.fps == pytest.approx(10.0)
    (source,) = sources(record_messages(tmp_path / "one.mcap", many[0], notes={}))
    assert source.fps == NOMINAL_FPS


def test_an_image_that_cannot_be_decoded_is_named_and_left_out(tmp_path):
    some = [(10.0 + n, CompressedFrame(t_s=10.0 + n, jpeg=b"no" if n == 1 else jpeg(90))) for n in range(3)]
    (source,) = sources(record_messages(tmp_path / "torn.mcap", *some, notes={}))
    refused = []
    assert [shot.number for shot in source.shots(refused.append)] == [0, 2]
    assert [str(error).partition(": ")[2] for error in refused] == ["the image of 11.000 s cannot be decoded"]
    assert len(source.sample(3)) == 2


def test_a_recording_brings_the_settings_of_its_car(tmp_path):
    car = tmp_path / "car"
    car.mkdir()
    (car / "camera.yaml").write_text("height_m: 0.9\n")
    images = (1.0, CompressedFrame(t_s=1.0, jpeg=jpeg(90)))
    path = tmp_path / "drive.mcap"
    with Recording(path, {"car/camera.yaml": (car / "camera.yaml").read_bytes()}, {"what": "test"}) as file:
        file.add(CAMERA_COMPRESSED.key, to_cdr(images[1]), at_s=1.0)
    (source,) = sources(path)
    assert source.has_settings
    with settings_of(source):
        assert load(CONFIG_DIR / "camera.yaml", Camera).height_m == 0.9
    assert load(CONFIG_DIR / "camera.yaml", Camera).height_m != 0.9
    assert not sources(record_messages(tmp_path / "foreign.mcap", images, notes={}))[0].has_settings


def test_a_recording_without_images_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match=r"holds no topic with .*, but no topic"):
        sources(record_messages(tmp_path / "empty.mcap", notes={}))


def test_a_corrupted_part_of_a_recording_is_named_and_the_images_behind_it_are_read(tmp_path, capsys):
    noise = np.random.default_rng(4).integers(0, 256, (5, 60, 80, 3), np.uint8)
    frames = [(10.0 + n, Frame(t_s=10.0 + n, image=noise[n])) for n in range(5)]
    path = record_messages(tmp_path / "drive.mcap", *frames, notes={})
    data = bytearray(path.read_bytes())
    data[data.index(noise[2, 0, :8].tobytes())] ^= 0xFF
    path.write_bytes(data)
    (source,) = sources(path)
    refused = []
    assert [shot.t_s for shot in source.shots(refused.append)] == [10.0, 11.0, 13.0, 14.0]
    assert re.search(r"bytes from byte \d+ on are corrupted.*, 1 images among them", str(*refused))
    with pytest.raises(InputError, match="are corrupted"):
        list(source.shots())
    assert len(source.sample(5)) == 4
    path.write_bytes(data[: len(data) * 9 // 10])
    assert [shot.t_s for shot in sources(path)[0].shots(refused.append)] == [10.0, 11.0, 13.0]
    assert "the file is cut short" in capsys.readouterr().err


def test_the_images_of_other_software_are_read_by_the_stamps_of_their_headers(tmp_path):
    pictures = [photo(50 * n) for n in range(4)]
    stamps_ns = [10**9 * (7 + 2 * n) for n in range(4)]
    messages = [
        (number, foreign.image(picture, "bgr8", stamp_ns=stamp_ns))
        for number, (picture, stamp_ns) in enumerate(zip(pictures, stamps_ns, strict=True))
    ]
    path = foreign.bag(tmp_path / "one", {"/usb_cam/image_raw": (IMAGE, messages)})
    (source,) = sources(path)
    shots = list(source.shots())
    assert [shot.t_s for shot in shots] == [7.0, 9.0, 11.0, 13.0] and source.fps == 0.5
    assert all(np.array_equal(shot.image, picture) for shot, picture in zip(shots, pictures, strict=True))
    assert len(source.sample(2)) == 2
    assert not is_recording(path)


def test_a_recording_of_two_cameras_is_refused_with_the_way_to_one(tmp_path):
    topics = {
        f"/{side}/image": (IMAGE, [(1, foreign.image(photo(90), "bgr8"))]) for side in ("left", "right")
    }
    path = foreign.bag(tmp_path / "two", topics)
    with pytest.raises(
        InputError, match=r"holds images on /left/image, /right/image; keep one .*mcap filter"
    ):
        sources(path)


def test_the_frames_of_a_video_have_the_stamps_of_the_file(tmp_path):
    times_ms = [0, 40, 80, 280, 480, 2480]
    path = matroska(tmp_path / "a.mkv", [photo(40 * n) for n in range(6)], times_ms, duration_ms=60_000.0)
    (source,) = sources(path)
    shots = list(source.shots())
    assert [shot.t_s for shot in shots] == pytest.approx([t / 1e3 for t in times_ms])
    assert [shot.number for shot in shots] == list(range(6))


def test_a_video_that_is_cut_short_gives_its_frames_before_it_is_refused(tmp_path):
    path = matroska(tmp_path / "a.mkv", [photo(40 * n) for n in range(6)], range(0, 240, 40))
    path.write_bytes(path.read_bytes()[:-50])
    found, (source,) = [], sources(path)
    with pytest.raises(
        InputError, match=r"video is truncated: \d frames can be read; 50 of \d+ bytes are missing"
    ):
        for shot in source.shots():
            found.append(shot.number)
    assert len(found) >= 4


@pytest.mark.parametrize("name", ["a.png", "a.webp"])
def test_of_an_animated_picture_the_first_is_read_and_the_line_says_so(tmp_path, name, capsys):
    animation = cv2.Animation()
    animation.frames = [np.full((48, 64, 4), grey, np.uint8) for grey in (60, 110, 160)]
    animation.durations = np.array([40, 40, 40])
    cv2.imwriteanimation(str(tmp_path / name), animation)
    (source,) = sources(tmp_path / name)
    for _ in range(2):
        (shot,) = source.shots()
        assert shot.image.mean() == pytest.approx(60, abs=4)
    assert capsys.readouterr().err == f"trepid: {tmp_path / name}: holds 3 pictures; the first one is read\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"version https://git-lfs.github.com/spec/v1\n", "is a Git LFS pointer, not the file"),
        (b"<!doctype html><html>404</html>", "is a web page: download the file itself"),
        (b"", "image file is empty"),
    ],
)
def test_what_stands_at_the_place_of_a_picture_is_named(tmp_path, content, said):
    path = tmp_path / "a.jpg"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"{path}: {said}"):
        read_image(path)


def test_the_lost_end_of_a_recording_is_said_once_however_often_it_is_read(tmp_path, capsys):
    messages = [
        (number, foreign.image(photo(90), "bgr8", stamp_ns=40_000_000 * number)) for number in range(1, 9)
    ]
    whole = foreign.bag(tmp_path / "one", {"/camera": (IMAGE, messages)})
    whole.write_bytes(whole.read_bytes()[:-20])
    (source,) = sources(whole)
    assert [len(list(source.shots())) for _ in range(2)] == [8, 8]
    assert capsys.readouterr().err.count("the file is cut short") == 1


def test_an_animated_gif_is_a_video_with_the_times_of_its_frames(tmp_path):
    animation = cv2.Animation()
    greys, durations_ms = [10, 60, 110, 160, 210], [40, 40, 200, 200, 40]
    animation.frames = [np.full((48, 64, 3), grey, np.uint8) for grey in greys]
    animation.durations = np.array(durations_ms)
    cv2.imwriteanimation(str(tmp_path / "a.gif"), animation)
    (source,) = sources(tmp_path / "a.gif")
    shots = list(source.shots())
    assert [round(1e3 * shot.t_s) for shot in shots] == [0, 40, 80, 280, 480]
    assert np.allclose([shot.image.mean() for shot in shots], greys, atol=4)


@pytest.mark.parametrize(
    ("name", "code"), [("a.ts", "mp4v"), ("a.MTS", "mp4v"), ("a.flv", "FLV1"), ("a.wmv", "WMV2")]
)
def test_the_videos_of_dash_cameras_and_older_recorders_are_read_by_their_stamps(tmp_path, name, code):
    plain = tmp_path / name.lower().replace(".mts", ".ts")
    writer = cv2.VideoWriter(str(plain), cv2.VideoWriter.fourcc(*code), 20.0, (64, 48))
    for grey in range(0, 200, 20):
        writer.write(np.full((48, 64, 3), grey, np.uint8))
    writer.release()
    (source,) = sources(plain.rename(tmp_path / name))
    shots = list(source.shots())
    assert [round(shot.t_s, 3) for shot in shots] == [round(0.05 * n, 3) for n in range(10)]
    assert np.allclose([shot.image.mean() for shot in shots], range(0, 200, 20), atol=4)
