"""Recordings of real cameras, which are not part of the project, through the sources."""

import os
from pathlib import Path

import pytest
from camera_source_rig import ManualClock, drive

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.images.files import images_in
from vehicle.cameras.files import FolderSettings, ImageFolder, VideoFile
from vehicle.cameras.playback import PlaybackSettings
from vehicle.cameras.source import CameraSource
from vehicle.cameras.working import Working, WorkingSettings

DATA = Path(os.environ.get("TREPID_DATA", ROOT.parent / "shared" / "data"))
FOLDERS = ["donkey_indoor_track/images", "camvid_road/val"]
VIDEOS = ["highway_udacity_p1/solidWhiteRight.mp4"]
MOST = 60


def there(name: str) -> Path:
    if not (DATA / name).exists():
        pytest.skip(f"{name} is not on this machine (TREPID_DATA)")
    return DATA / name


def worked_off(source: CameraSource) -> int:
    """Frames that reach the working size."""
    working = Working(WorkingSettings(source="x", fit="crop"), load(CONFIG_DIR / "camera.yaml", Camera))
    count = 0
    while not source.ended and count < MOST:
        frame = source.read(timeout_s=0.0)
        assert frame is not None, source.trouble
        assert working.step(frame).image.shape == (240, 320, 3)
        count += 1
    return count


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_of_a_real_set_plays(name: str) -> None:
    assert worked_off(ImageFolder(FolderSettings(path=str(there(name)), pace=0), drive(ManualClock()))) >= 20


@pytest.mark.parametrize("name", VIDEOS)
def test_a_video_of_a_real_set_plays(name: str) -> None:
    assert worked_off(VideoFile(PlaybackSettings(path=str(there(name)), pace=0), drive(ManualClock()))) >= 20


def test_the_frames_of_a_donkey_car_play_in_the_order_of_their_numbers() -> None:
    folder = there("donkey_indoor_track/images")
    numbers = [int(path.name.split("_")[0]) for path in images_in(folder)]
    assert numbers == sorted(numbers) and len(numbers) > 100
