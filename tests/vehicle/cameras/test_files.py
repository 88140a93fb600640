"""Video files and folders of images as camera sources."""

from pathlib import Path

import pytest
from camera_source_rig import ManualClock, drive, folder_of, number_of, video_of
from image_file_rig import png_of_size

from trepid.config import InputError, use_car
from trepid.images.files import images_in
from vehicle.cameras.files import FolderSettings, ImageFolder, VideoFile
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
