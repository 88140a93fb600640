"""The verb ``trepid camera calibrate``."""

import json
from pathlib import Path

import chessboard_rig as chessboard
import cv2
import numpy as np
import pytest
import straight_drive_rig as drives
from typer.testing import CliRunner

from cockpit.calibration.camera_cli import app
from cockpit.calibration.height import Step
from trepid.__main__ import main
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import CompressedFrame, Frame, VehicleState
from trepid.recording.writer import Recording
from trepid.wire import to_cdr
from vehicle.cameras.working import Working, WorkingSettings


def run(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    monkeypatch.setattr("sys.argv", ["trepid", "camera", "calibrate", *map(str, words)])
    return main()


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards")
    for number, pose in enumerate(chessboard.POSES):
        cv2.imwrite(str(folder / f"{number}.png"), chessboard.draw_board(*pose))
    return folder


def folder_of(steps: tuple[Step, ...], folder: Path) -> Path:
    for number, step in enumerate(steps):
        cv2.imwrite(str(folder / f"{number:03}.png"), step.image)
    return folder


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(drives.clip("yellow"), tmp_path_factory.mktemp("drive"))


@pytest.fixture(scope="module")
def of_boards(boards: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The camera file that is measured with the boards, and what is printed."""
    out = tmp_path_factory.mktemp("measured") / "mine.yaml"
    shown = CliRunner().invoke(
        app, ["calibrate", str(boards), "--corners", "7x5", "--out", str(out), "--json"]
    )
    assert shown.exit_code == 0
    return out, shown.stdout


def test_a_chessboard_gives_a_camera_file_that_loads(of_boards: tuple[Path, str]) -> None:
    out, printed = of_boards
    report = json.loads(printed)
    camera = load(out, Camera)
    assert (camera.width_px, camera.height_px) == chessboard.SIZE_PX
    assert camera.fx_px == pytest.approx(430.0, rel=2e-3)
    assert camera.height_m == load(CONFIG_DIR / "camera.yaml", Camera).height_m  # not measured
    assert report["camera"]["fx_px"] == camera.fx_px
    assert len(report["intrinsics"]["boards"]) == len(chessboard.POSES)


def test_a_straight_drive_gives_the_mounting_and_keeps_the_lens(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "mine.yaml"
    assert run(monkeypatch, "--straight", drive, "--lane-width", drives.LANE_M, "--out", out) == 0
    camera = load(out, Camera)
    assert camera.fx_px == drives.KNOWN.fx_px
    assert camera.pitch_down_rad == pytest.approx(drives.TRUE.pitch_down_rad, abs=0.005)
    assert camera.height_m == pytest.approx(drives.TRUE.height_m, rel=0.03)


def test_a_swerving_drive_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    swerving = folder_of(drives.clip("yellow", sway_m=0.3), tmp_path)
    assert run(monkeypatch, "--straight", swerving, "--lane-width", drives.LANE_M) == 2
    out, error = capsys.readouterr()
    assert "the vehicle does not drive straight: the heading sways by 1.9°, 1.1° allowed" in error
    assert out == "" and len(error.splitlines()) == 1


def test_an_existing_file_is_kept_unless_forced(
    boards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.yaml"
    out.write_text("precious")
    assert run(monkeypatch, boards, "--corners", "7x5", "--out", out) == 2
    assert out.read_text() == "precious"
    assert "exists; --force overwrites it" in capsys.readouterr().err
    assert run(monkeypatch, boards, "--corners", "7x5", "--out", out, "--force") == 0
    assert load(out, Camera)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "expected images of a chessboard"),
        (["--straight", "{tmp}/none.mp4"], "no such file or folder"),
        (["{tmp}", "--corners", "9by6"], "expected columns x rows"),
        (["{tmp}", "--corners", "2x2"], "expected columns x rows"),
        (["--straight", "{tmp}", "--lane-width", "-3"], "--lane-width: must be a number of at least 0.1"),
        (["{tmp}", "--lane-width", "3"], "--lane-width: is of the drive of --straight"),
        (["--straight", "{tmp}", "--speed", "nan"], "--speed: must be a number of at least 1"),
        (["--straight", "{tmp}/wide.png"], "64 x 16 px, but the camera file is for 320 x 240"),
        (["--straight", "{tmp}/bad.mcap"], "bad.mcap"),
        (["--drive", "{tmp}/none.mcap"], "none.mcap"),
        (["--drive", "{tmp}/empty.mcap"], "holds no"),
        (["--drive", "{tmp}/empty.mcap", "--straight", "{tmp}"], "give --straight or --drive, not both"),
        (["--drive", "{tmp}/empty.mcap", "--speed", "8"], "--speed: is of the drive of --straight"),
    ],
)
def test_bad_usage_gives_one_line(
    words: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((16, 64, 3), np.uint8))
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    with Recording(tmp_path / "empty.mcap"):
        pass
    assert run(monkeypatch, *(word.format(tmp=tmp_path) for word in words)) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert len(error.splitlines()) == 1


def test_a_recording_gives_the_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "drive.mcap"
    with Recording(path) as recording:
        for number, step in enumerate(drives.clip("white")):
            for image, t_s in ((step.image, float(number)), (step.following, number + drives.PERIOD_S)):
                jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
                frame = CompressedFrame(t_s=100 + t_s, jpeg=jpeg)
                recording.add("camera/image/compressed", to_cdr(frame), at_s=100 + t_s)
                state = VehicleState(
                    t_s=100 + t_s,
                    speed_mps=drives.SPEED_MPS,
                    road_wheel_angle_rad=0.0,
                    yaw_rate_radps=0.0,
                    driver_override=False,
                )
                recording.add("vehicle/state", to_cdr(state), at_s=100 + t_s)
    assert run(monkeypatch, "--straight", path, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["extrinsics"]["height_from"] == "the speed"
    assert report["camera"]["height_m"] == pytest.approx(drives.TRUE.height_m, rel=0.03)


def test_the_file_is_accepted_by_estimate_and_by_a_car_at_the_scaled_resolution(
    boards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    car = tmp_path / "car"
    car.mkdir()
    out = car / "camera.yaml"
    assert run(monkeypatch, boards, "--corners", "7x5", "--width", 320, "--out", out) == 0
    capsys.readouterr()
    monkeypatch.setattr(
        "sys.argv", ["trepid", "estimate", "--camera", str(out), "--json", str(boards / "1.png")]
    )
    assert main() == 0  # an image of 480 x 360 px
    assert json.loads(capsys.readouterr().out)["file"] == str(boards / "1.png")
    monkeypatch.setenv("TREPID_CAR", str(car))
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    assert (camera.width_px, camera.height_px) == (320, 240)
    scale = 320 / chessboard.SIZE_PX[0]
    assert camera.fx_px == pytest.approx(scale * 430.0, rel=2e-3)
    assert camera.cx_px == pytest.approx((chessboard.MATRIX[0, 2] + 0.5) * scale - 0.5, abs=0.5)
    assert camera.distortion[0] == pytest.approx(chessboard.DISTORTION[0], abs=0.02)  # free of the scale
    source = WorkingSettings(source="video")
    picture = cv2.imread(str(boards / "1.png"))
    assert Working(source, camera).step(Frame(t_s=1.0, image=picture)).image.shape == (240, 320, 3)


def test_boards_of_a_turned_camera_give_the_camera_of_the_upright_image(
    boards: Path, of_boards: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned = tmp_path / "turned"
    turned.mkdir()
    for path in boards.iterdir():
        cv2.imwrite(
            str(turned / path.name), cv2.rotate(cv2.imread(str(path)), cv2.ROTATE_90_COUNTERCLOCKWISE)
        )
    out = tmp_path / "turned.yaml"
    assert run(monkeypatch, turned, "--corners", "7x5", "--rotate", 90, "--out", out) == 0
    assert load(out, Camera) == load(of_boards[0], Camera)


@pytest.mark.parametrize(
    ("option", "value"), [("--width", "10"), ("--rotate", "45"), ("--mirror", "sideways"), ("--width", "1e3")]
)
def test_a_wrong_size_or_turn_is_refused(
    boards: Path, option: str, value: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, boards, option, value) == 2
    assert option in capsys.readouterr().err
