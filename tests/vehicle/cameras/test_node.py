"""The step of the camera process, and the process itself on a bus."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_source_rig import folder_of
from process_rig import until

from trepid.bus import Bus, free_endpoint, open_bus
from trepid.car.camera import Camera
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.images.jpeg import RateFilter
from trepid.messages import Frame, Health
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE, DIAGNOSTICS
from vehicle.cameras.node import CameraStep, FrameStatistics, exposure
from vehicle.cameras.working import WorkingSettings

PATIENCE_S = 30.0
OFFSET_NS = epoch_offset_ns()


def node(**settings: object) -> CameraStep:
    known = WorkingSettings.model_validate({"source": "video", **settings})
    return CameraStep(known, load(CONFIG_DIR / "camera.yaml", Camera))


def frame(t_s: float, size: tuple[int, int] = (640, 480)) -> Frame:
    return Frame(t_s=t_s, image=np.full((size[1], size[0], 3), 90, np.uint8))


@pytest.mark.parametrize(("settings", "count"), [({}, 30), ({"compressed_hz": 10.0}, 10)])
def test_every_frame_is_published_and_encoded_as_often_as_set(settings: dict[str, float], count: int) -> None:
    step = node(**settings)
    results = [step.step(frame(10 + n / 30)) for n in range(30)]
    assert [working.t_s for working in results if working] == [10 + n / 30 for n in range(30)]
    assert sum(step.encoder.step(working) is not None for working in results if working) == count


@pytest.mark.parametrize(("given_hz", "limit_hz", "published"), [(30, 15, 15), (30, 25, 25), (30, 60, 30)])
def test_a_highest_rate_leaves_frames_out(given_hz: int, limit_hz: float, published: int) -> None:
    rate = RateFilter(limit_hz)
    passed = sum(rate.passes(50 + n / given_hz) for n in range(10 * given_hz)) / 10
    assert passed == pytest.approx(published, rel=0.05)


def test_a_refused_frame_is_a_warning_until_a_good_one_comes() -> None:
    step = node()
    step.step(frame(10.0))
    assert step.health(True, "", now_s=10.0) == (Health.OK, "")
    assert step.step(frame(10.1, (1280, 720))) is None
    health, message = step.health(False, "", now_s=10.1)
    assert health is Health.WARN and "1280 x 720 px refused" in message
    working = step.step(frame(10.2))
    assert step.health(working is not None, "", now_s=10.2) == (Health.OK, "")
    assert ("refused_frames", "1") in step.values()


def test_silence_is_a_warning_with_the_reason_of_the_source() -> None:
    step = node(silence_s=0.3)
    step.step(frame(10.0))
    step.health(True, "", now_s=10.0)
    assert step.health(False, "unplugged", now_s=10.2)[0] is Health.OK
    assert step.health(False, "unplugged", now_s=10.4) == (Health.WARN, "no frame: unplugged")


@pytest.fixture
def hub() -> Iterator[tuple[Bus, str]]:
    endpoint = free_endpoint()
    with open_bus("car", epoch_clock(OFFSET_NS), listen=endpoint) as bus:
        yield bus, endpoint


def start_camera(endpoint: str, car: Path, text: str, *, restarts: int = 0) -> subprocess.Popen[str]:
    """The camera process of a car."""
    car.mkdir(exist_ok=True)
    (car / "camera_source.yaml").write_text(text)
    task = dict(
        name="camera",
        vehicle_name="car",
        connect=endpoint,
        clock_offset_ns=OFFSET_NS,
        options={},
        restarts=restarts,
    )
    words = [sys.executable, "-m", "vehicle.cameras.node", json.dumps(task)]
    environment = {"TREPID_CAR": str(car), "PATH": "", "PYTHONPATH": str(ROOT)}
    pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    return subprocess.Popen(words, cwd=ROOT, env=environment, text=True, **pipes)


def test_the_process_publishes_frames_jpegs_and_a_heartbeat_with_statistics(
    hub: tuple[Bus, str], tmp_path: Path
) -> None:
    bus, endpoint = hub
    frames, jpegs, beats = bus.latest(CAMERA_IMAGE), bus.latest(CAMERA_COMPRESSED), bus.stream(DIAGNOSTICS)
    folder = folder_of(tmp_path / "frames", 3)
    text = f"source: folder\nmount: {{rotate_deg: 180}}\nfolder:\n  path: {folder}\n  loop: true\n"
    child = start_camera(endpoint, tmp_path / "car", text)
    try:
        assert until(lambda: frames.refresh() and jpegs.refresh(), patience_s=PATIENCE_S)
        values: dict[str, str] = {}

        def is_told() -> bool:
            for beat, _ in beats.drain():
                values.update(beat.values)
            return "gap_median_ms" in values

        assert until(is_told, patience_s=PATIENCE_S)
    finally:
        child.terminate()
        child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 0
    newest = frames.message
    assert newest is not None and newest.image.shape == (240, 320, 3)
    assert abs(newest.t_s - (time.monotonic() + OFFSET_NS * 1e-9)) < 60  # the clock of the drive
    assert jpegs.message is not None
    assert cv2.imdecode(np.frombuffer(jpegs.message.jpeg, np.uint8), 1).shape == (240, 320, 3)
    assert (values["source"], values["source_px"], values["stamped_by"]) == ("folder", "64x48", "recording")
    assert {"brightness", "over_exposed", "gap_max_ms", "missing_frames"} <= values.keys()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("source: camera\n", "unknown camera source 'camera'"),
        ("source: v4l2\nv4l2:\n  device: 77\n", "/dev/video77: no such device"),
        ("source: video\nvideo:\n  path: broken.mp4\n", "broken.mp4: cannot be read as a video"),
    ],
)
def test_a_wrong_source_ends_the_process_with_one_line_and_code_2(
    hub: tuple[Bus, str], tmp_path: Path, text: str, problem: str
) -> None:
    (tmp_path / "car").mkdir()
    (tmp_path / "car" / "broken.mp4").write_text("no video")
    child = start_camera(hub[1], tmp_path / "car", text)
    _, error = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 2
    assert problem in error and len(error.strip().splitlines()) == 1


def test_a_camera_that_is_absent_when_its_process_starts_again_is_waited_for(
    hub: tuple[Bus, str], tmp_path: Path
) -> None:
    bus, endpoint = hub
    frames, beats = bus.latest(CAMERA_IMAGE), bus.latest(DIAGNOSTICS)
    text = f"source: folder\nfolder:\n  path: {tmp_path / 'frames'}\n  loop: true\n"
    child = start_camera(endpoint, tmp_path / "car", text, restarts=1)
    try:
        absent = "no frame: "

        def says_so() -> bool:
            beat = beats.take()
            return beat is not None and beat.health is Health.WARN and beat.message.startswith(absent)

        assert until(says_so, patience_s=PATIENCE_S)
        folder_of(tmp_path / "frames", 3)
        assert until(lambda: frames.refresh() is not None, patience_s=PATIENCE_S)
    finally:
        child.terminate()
        child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 0


def test_wrong_settings_are_refused_after_a_restart_too(hub: tuple[Bus, str], tmp_path: Path) -> None:
    child = start_camera(hub[1], tmp_path / "car", "source: camera\n", restarts=1)
    _, error = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 2
    assert "unknown camera source" in error


def statistics_of(times_s: list[float]) -> dict[str, str]:
    statistics = FrameStatistics()
    for t_s in times_s:
        statistics.add(Frame(t_s=t_s, image=np.full((48, 64, 3), 51, np.uint8)))
    return dict(statistics.values())


def test_a_regular_camera_misses_nothing() -> None:
    values = statistics_of([0.0, 0.04, 0.08, 0.12])
    assert values["gap_median_ms"] == values["gap_max_ms"] == "40.0"
    assert values["missing_frames"] == "0"


def test_a_gap_of_several_periods_counts_the_missing_frames() -> None:
    values = statistics_of([0.0, 0.04, 0.08, 0.20, 0.24, 0.28])
    assert (values["gap_max_ms"], values["missing_frames"]) == ("120.0", "2")


def test_missing_frames_add_up_and_gaps_begin_anew_at_every_heartbeat() -> None:
    statistics = FrameStatistics()
    times_s = iter([0.0, 0.04, 0.08, 0.16, 0.20, 0.24, 0.28])
    found = []
    for count in (4, 3):
        for _ in range(count):
            statistics.add(Frame(t_s=next(times_s), image=np.zeros((48, 64, 3), np.uint8)))
        found.append(dict(statistics.values()))
    assert [values["missing_frames"] for values in found] == ["1", "1"]
    assert found[1]["gap_max_ms"] == "40.0"


def test_without_frames_there_are_no_gaps_and_no_exposure() -> None:
    assert set(statistics_of([])) == {"missing_frames", "refused_frames"}


@pytest.mark.parametrize(
    ("level", "expected"),
    [(51, ("0.200", "0.000", "0.000")), (255, ("1.000", "1.000", "0.000")), (0, ("0.000", "0.000", "1.000"))],
)
def test_exposure_is_the_mean_and_the_shares_at_both_ends(level: int, expected: tuple[str, str, str]) -> None:
    values = dict(exposure(np.full((48, 64, 3), level, np.uint8)))
    assert (values["brightness"], values["over_exposed"], values["under_exposed"]) == expected
