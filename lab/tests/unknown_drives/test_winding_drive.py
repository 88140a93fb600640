"""``trepid camera calibrate --drive``: the camera of an ordinary recorded drive."""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import cv2
import pytest

from cockpit.calibration.camera_cli import camera_yaml
from cockpit.calibration.winding_drive import DrivenFrame, camera_by_driving, recorded_frames
from lab.bench.perception.unknown_camera import OdometryFrame, unknown_drive
from trepid.__main__ import main
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.messages import CompressedFrame, VehicleState
from trepid.recording.writer import Recording
from trepid.wire import to_cdr

SEED, NUMBER = 7, 2
FIRST_S = 100.0


@cache
def drive() -> tuple[Camera, tuple[OdometryFrame, ...]]:
    one = unknown_drive(SEED, NUMBER)
    return one.camera, tuple(one.moments())


def frames(count: int | None = None) -> Iterator[DrivenFrame]:
    for one in drive()[1][:count]:
        yield DrivenFrame(one.image, one.t_s, one.speed_mps, one.yaw_rate_radps)


def start(share: float = 1.2, **changes: float) -> Camera:
    true = drive()[0]
    wrong = {
        "fx_px": share * true.fx_px,
        "fy_px": share * true.fy_px,
        "height_m": 0.85 * true.height_m,
        "yaw_rad": 0.0,
    }
    return true.model_copy(update=wrong | changes)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    with Recording(path) as file:
        for one in drive()[1]:
            at_s = FIRST_S + one.t_s
            jpeg = cv2.imencode(".jpg", one.image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            state = VehicleState(
                t_s=at_s,
                speed_mps=one.speed_mps,
                road_wheel_angle_rad=0.0,
                yaw_rate_radps=one.yaw_rate_radps,
                driver_override=True,
            )
            file.add("vehicle/state", to_cdr(state), at_s=at_s)
            file.add("camera/image/compressed", to_cdr(CompressedFrame(t_s=at_s, jpeg=jpeg)), at_s=at_s)
    return path


def calibrate(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    monkeypatch.setattr("sys.argv", ["trepid", "camera", "calibrate", *map(str, words)])
    return main()


def test_a_recorded_drive_gives_lens_and_mounting(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    true, file = drive()[0], tmp_path / "start.yaml"
    file.write_text(camera_yaml(start(), {}))
    assert calibrate(monkeypatch, "--camera", file, "--drive", recording, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    found = Camera.model_validate(report["camera"])
    assert found.fx_px == pytest.approx(true.fx_px, rel=0.05)
    assert found.height_m == pytest.approx(true.height_m, rel=0.06)
    assert found.pitch_down_rad == pytest.approx(true.pitch_down_rad, abs=0.01)
    assert found.yaw_rad == pytest.approx(true.yaw_rad, abs=0.01)
    assert report["drive"]["pairs"] >= 50 and 0.02 < report["drive"]["focal_doubt"] < 0.1


def test_a_known_lens_is_kept_and_gives_the_height() -> None:
    true = drive()[0]
    found = camera_by_driving(frames(), start(1.0), Path("drive"), lens_known=True)
    assert found.camera.fx_px == true.fx_px and found.focal_doubt is None
    assert found.camera.height_m == pytest.approx(true.height_m, rel=0.04)


def test_the_states_of_a_recording_are_those_at_the_frames(recording: Path) -> None:
    for one, moment in zip(recorded_frames(recording), drive()[1], strict=True):
        assert one.speed_mps == pytest.approx(moment.speed_mps, rel=1e-6)
        assert one.yaw_rate_radps == pytest.approx(moment.yaw_rate_radps, abs=1e-6)


def test_without_fresh_states_the_odometry_of_a_frame_is_not_known(tmp_path: Path) -> None:
    path, (camera, moments) = tmp_path / "late.mcap", drive()
    jpeg = cv2.imencode(".jpg", moments[0].image)[1].tobytes()
    state = VehicleState(
        t_s=1.0, speed_mps=9.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.1, driver_override=True
    )
    with Recording(path) as file:
        file.add("vehicle/state", to_cdr(state), at_s=1.0)
        file.add("camera/image/compressed", to_cdr(CompressedFrame(t_s=1.3, jpeg=jpeg)), at_s=1.3)
    (frame,) = recorded_frames(path)
    assert (frame.speed_mps, frame.yaw_rate_radps) == (None, None)
    assert frame.image.shape == (camera.height_px, camera.width_px, 3)


def test_a_drive_without_bends_measures_no_lens() -> None:
    straight = (one._replace(yaw_rate_radps=0.0) for one in frames())
    with pytest.raises(InputError, match="the drive hardly turns"):
        camera_by_driving(straight, start(), Path("drive"), lens_known=False)


def test_a_short_drive_is_refused() -> None:
    with pytest.raises(InputError, match="50 expected: drive longer"):
        camera_by_driving(frames(30), start(), Path("drive"), lens_known=False)


def test_a_camera_file_that_is_far_off_is_refused() -> None:
    with pytest.raises(InputError, match=r"the height would be 0\.\d times that of the camera file"):
        camera_by_driving(frames(), start(1.0, height_m=4.0), Path("drive"), lens_known=True)
