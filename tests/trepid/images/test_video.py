"""Videos are read by their stamps to their end, and what cannot be read is called by its name."""

import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from video_rig import UNKNOWN, element, matroska

from trepid.config import InputError
from trepid.images.containers import damage_of, loss_of
from trepid.images.video import count_frames, spread_images, video_frames

TIMES_MS = [*range(0, 400, 40), *range(600, 2600, 200), 9000]
IMAGES = [np.full((48, 64, 3), 10 * n, np.uint8) for n in range(len(TIMES_MS))]


def numbers_of(images: list[np.ndarray]) -> list[int]:
    return [round(float(image.mean()) / 10) for image in images]


def film(path: Path, count: int = 12, images: Sequence[np.ndarray] = IMAGES) -> Path:
    """A video of OpenCV; the container is that of the suffix."""
    code = cv2.VideoWriter.fourcc(*("MJPG" if path.suffix == ".avi" else "mp4v"))
    writer = cv2.VideoWriter(str(path), code, 25.0, (64, 48))
    for image in images[:count]:
        writer.write(image)
    writer.release()
    return path


@pytest.mark.parametrize("duration_ms", [None, 9040.0, 60_000.0, 400.0])
@pytest.mark.parametrize("known", [True, False])
def test_matroska_is_read_to_its_end_by_its_stamps_whatever_it_announces(
    tmp_path: Path, known: bool, duration_ms: float | None
) -> None:
    path = matroska(tmp_path / "a.mkv", IMAGES, TIMES_MS, duration_ms=duration_ms, known=known)
    frames = [(frame.number, frame.t_s, frame.decode()) for frame in video_frames(path)]
    assert [number for number, _, _ in frames] == list(range(len(IMAGES)))
    assert [t_s for _, t_s, _ in frames] == pytest.approx([t / 1e3 for t in TIMES_MS])
    assert numbers_of([image for _, _, image in frames]) == list(range(len(IMAGES)))
    assert count_frames(path) == len(IMAGES) and loss_of(path) == ""
    assert numbers_of(spread_images(path, 3)) == [0, 10, 20]


def test_a_stamp_that_does_not_follow_is_one_period_after_the_one_before(tmp_path: Path) -> None:
    path = matroska(tmp_path / "a.mkv", IMAGES[:5], [0, 40, 40, 120, 160])
    t_s = [frame.t_s for frame in video_frames(path)]
    assert t_s[0] == 0.0 and (np.diff(t_s) > 0).all()


def test_a_clock_that_steps_back_leaves_no_two_frames_at_one_time(tmp_path: Path) -> None:
    stepped = [*range(0, 160, 40), *range(40, 680, 40)]
    path = matroska(tmp_path / "a.mkv", IMAGES[:20], stepped)
    assert np.diff([frame.t_s for frame in video_frames(path)]).min() > 1e-3


@pytest.mark.parametrize("name", ["a.mp4", "a.mov", "a.avi"])
def test_a_film_of_opencv_is_whole_and_a_part_of_it_is_called_cut(tmp_path: Path, name: str) -> None:
    path = film(tmp_path / name)
    assert [frame.t_s for frame in video_frames(path)] == pytest.approx([n / 25 for n in range(12)])
    assert loss_of(path) == "" and numbers_of(spread_images(path, 4)) == pytest.approx([0, 3, 7, 11], abs=1)
    data = path.read_bytes()
    for share in (0.3, 0.7, 0.95):
        path.write_bytes(data[: int(share * len(data))])
        lost = len(data) - path.stat().st_size
        said = re.search(r"(\d+) (?:of \d+ )?bytes are missing|moov", loss_of(path))
        assert said is not None and int(said[1] or 0) <= lost


def test_matroska_that_knows_its_length_is_called_cut(tmp_path: Path) -> None:
    path = matroska(tmp_path / "a.mkv", IMAGES, TIMES_MS)
    data = path.read_bytes()
    path.write_bytes(data[:-100])
    assert loss_of(path) == f"100 of {len(data)} bytes are missing"
    assert 0 < count_frames(path) < len(IMAGES)


@pytest.mark.parametrize("nested", [False, True])
def test_a_live_recording_is_called_cut_where_its_last_frame_is(tmp_path: Path, nested: bool) -> None:
    path = matroska(tmp_path / "a.webm", IMAGES, TIMES_MS, known=False)
    data = path.read_bytes()
    if nested:  # clusters without lengths, as MediaRecorder writes them
        parts = data.split(bytes.fromhex("1f43b675"))
        data = parts[0] + b"".join(bytes.fromhex("1f43b675") + UNKNOWN + part[8:] for part in parts[1:])
        path.write_bytes(data)
    assert loss_of(path) == "" and count_frames(path) == len(IMAGES)
    for lost in (1, 20, 100):
        path.write_bytes(data[:-lost])
        assert loss_of(path) == f"at least {lost} bytes are missing"


@pytest.mark.parametrize("name", ["film.avi", "film.mkv"])
def test_a_film_goes_on_behind_a_damaged_frame_which_is_said(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    images = list(np.random.default_rng(0).integers(0, 256, (12, 48, 64, 3), np.uint8))
    if path.suffix == ".avi":
        film(path, images=images)
    else:
        matroska(path, images, range(0, 40 * len(images), 40))
    whole = [frame.t_s for frame in video_frames(path)]
    data = bytearray(path.read_bytes())
    place = data.index(b"\xff\xd8\xff", len(data) // 2)  # the beginning of a JPEG
    data[place : place + 300] = b"\x55" * 300
    path.write_bytes(data)
    left = [frame.t_s for frame in video_frames(path)]
    assert set(left) < set(whole) and len(left) == len(whole) - 1 and left[-1] == whole[-1]
    assert count_frames(path) == len(left)
    said = [line for line in capfd.readouterr().err.splitlines() if "damaged before frame" in line]
    assert len(said) == 1 and said[0].endswith("1 frames cannot be decoded; left out")


def counted_film(path: Path, code: str) -> Path:
    """60 frames at 20 Hz, each of the brightness of four times its number, beside noise."""
    noise = np.random.default_rng(0).integers(0, 256, (60, 64, 96, 3), np.uint8)
    noise[:, :32] = 4 * np.arange(60, dtype=np.uint8)[:, None, None, None]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 20.0, (96, 64))
    for image in noise:
        writer.write(image)
    writer.release()
    return path


@pytest.mark.parametrize(
    ("name", "code"), [("a.webm", "VP80"), ("b.webm", "VP90"), ("c.mkv", "MJPG"), ("d.avi", "MJPG")]
)
@pytest.mark.parametrize("damage", ["zeros", "noise"])
def test_what_a_film_loses_in_its_middle_is_said_and_the_rest_is_read(
    tmp_path: Path, name: str, code: str, damage: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = counted_film(tmp_path / name, code)
    assert count_frames(path) == 60 and damage_of(path) == ""
    data = bytearray(path.read_bytes())
    size = len(data) // 20
    broken = np.random.default_rng(1).bytes(size) if damage == "noise" else bytes(size)
    data[len(data) // 2 : len(data) // 2 + size] = broken
    path.write_bytes(data)
    left = [(frame.t_s, frame.decode()[4:28].mean() / 4.0) for frame in video_frames(path)]
    assert 40 < len(left) < 60 and left[-1][1] == pytest.approx(59.0, abs=1.5)
    said = [line for line in capfd.readouterr().err.splitlines() if ": damaged at byte" in line]
    assert len(said) == 1 and "frames there are lost" in said[0]
    assert said[0].endswith("those after them come too early") == (path.suffix == ".avi")
    if path.suffix != ".avi":  # there the stamps are those of the frames
        assert all(20.0 * t_s == pytest.approx(shown, abs=1.5) for t_s, shown in left)


def test_bytes_after_a_whole_film_are_no_loss(tmp_path: Path) -> None:
    for path in (film(tmp_path / "a.mp4"), matroska(tmp_path / "a.mkv", IMAGES, TIMES_MS)):
        path.write_bytes(path.read_bytes() + bytes(4096))
        assert loss_of(path) == "" and damage_of(path) == ""


def test_a_missing_decoder_is_called_so_with_the_command_that_converts(tmp_path: Path) -> None:
    path = matroska(tmp_path / "my drive.mkv", IMAGES[:3], [0, 40, 80], codec="V_AV1")
    with pytest.raises(InputError) as refused:
        list(video_frames(path))
    assert str(refused.value) == (
        f"{path}: AV1: this OpenCV cannot decode it; convert it: ffmpeg -i '{path}' -c:v libx264"
        f" '{tmp_path / 'my drive-h264.mp4'}'"
    )


def test_pictures_that_a_known_decoder_cannot_read_are_called_damaged(tmp_path: Path) -> None:
    path = matroska(tmp_path / "drive.mkv", IMAGES[:3], [0, 40, 80], codec="V_VP9")
    with pytest.raises(InputError, match=r"drive\.mkv: VP9: damaged: no picture in it can be decoded"):
        list(video_frames(path))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "video is truncated: the file is empty"),
        (b"version https://git-lfs.github.com/spec/v1\n", "is a Git LFS pointer, not the file"),
        (b"<!DOCTYPE html>\n<html>404</html>", "is a web page: download the file itself"),
        (b"no video", "cannot be read as a video"),
        ((64).to_bytes(4, "big") + b"mdat" + bytes(56), "video is truncated: its index (moov) is missing"),
        (
            (640).to_bytes(4, "big") + b"mdat" + bytes(56),
            "video is truncated: at least 576 bytes are missing",
        ),
        (element("1a45dfa3", b""), "its codec: this OpenCV cannot decode it; convert it: ffmpeg"),
    ],
    ids=["empty", "pointer", "web page", "text", "no index", "cut", "no tracks"],
)
def test_a_file_without_a_frame_is_refused_by_its_cause(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        list(video_frames(path))
    assert f"{path}: {said}" in str(refused.value) and "\n" not in str(refused.value)
