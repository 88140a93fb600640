"""The commands of docs/your-car.md, in their order: from `init` through an own video to a CAN counterpart."""

import os
import subprocess
from pathlib import Path

import can
import cv2
import pytest
from page_rig import checkout_like, console_blocks, run

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.recording.reader import read_recording
from trepid.topics import COMMAND, VEHICLE_STATE

COMMANDS = [command for block in console_blocks("your-car.md")[:2] for command in block]
SETS_UP = 4  # clone, make, activate, pip
DURATION_S = 12  # of the film and of the drive, 20 s in the page: a film at its end counts as a frozen camera
RATE_HZ, SPEED_MPS = 25.0, 6.0
DRIVE = "trepid drive"
MAY_FAIL = (
    "trepid doctor",  # on a loaded machine, and because the ECU is silent outside a drive
    DRIVE,  # with a departure: a film does not respond to the steering
)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder like the checkout, with a video and `trepid` on the path."""
    film_of_a_straight_road(tmp_path / "VIDEO.mp4")
    return checkout_like(tmp_path)


def film_of_a_straight_road(path: Path) -> None:
    """The view from the middle of the lane at 6 m/s."""
    road, camera = load_road("straight"), load(CONFIG_DIR / "camera.yaml", Camera)
    renderer = Renderer(road, camera, seed=0)
    film = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (camera.width_px, camera.height_px)
    )
    for frame in range(round(DURATION_S * RATE_HZ)):
        station_m = 20.0 + SPEED_MPS * frame / RATE_HZ
        pose = (*road.position(station_m, 0.0), road.heading_at(station_m))
        film.write(renderer.render(*pose, t_s=frame / RATE_HZ, station_m=station_m))
    film.release()


def test_ten_commands_are_enough() -> None:
    assert len(COMMANDS) == 10
    assert COMMANDS[0].startswith("git clone") and COMMANDS[SETS_UP].startswith("trepid init")


@pytest.fixture
def multicast() -> None:
    """Skips where this machine has no multicast."""
    try:
        can.Bus(interface="udp_multicast", channel="239.74.163.2", port=43113, hop_limit=0).shutdown()
    except can.CanError as error:
        pytest.skip(f"no multicast on this machine: {error}")


def recorded_a_drive(folder: Path) -> None:
    """The ten commands have annotated the video, and recorded a drive in which the ECU reports speeds over CAN."""
    assert (folder / "lanes.mp4").stat().st_size > 10_000
    recorded = read_recording(folder / "drive.mcap", COMMAND.key, VEHICLE_STATE.key)
    speeds = [message.speed_mps or 0.0 for _, message in recorded.of(VEHICLE_STATE)]
    assert max(speeds) > 1.0
    commands = [message for _, message in recorded.of(COMMAND) if message.t_s is not None]
    assert len(commands) > 100


@pytest.mark.processes
def test_an_own_video_drives_a_can_counterpart(work: Path, multicast: None) -> None:
    assert "--duration 20" in COMMANDS[-1]
    for command in COMMANDS[SETS_UP:]:
        done = run(command.replace("--duration 20", f"--duration {DURATION_S}"), work)
        good = (0, 1) if command.startswith(MAY_FAIL) else (0,)
        assert done.returncode in good, f"{command}: {done.stdout}{done.stderr}"
    assert done.returncode == 0 or "departures" in done.stdout, f"{done.stdout}{done.stderr}"
    recorded_a_drive(work)


@pytest.mark.proof
def test_all_ten_commands_in_one_shell_from_a_fresh_clone(tmp_path: Path, multicast: None) -> None:
    film_of_a_straight_road(tmp_path / "VIDEO.mp4")
    lines = [f"{line} || test $? = 1" if line.startswith(MAY_FAIL) else line for line in COMMANDS]
    script = "\n".join(["set -ex", *lines])
    script = script.replace("REPOSITORY", str(ROOT)).replace("VIDEO.mp4", str(tmp_path / "VIDEO.mp4"))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TREPID")}
    done = subprocess.run(
        ["/bin/sh", "-c", script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    recorded_a_drive(tmp_path / "trepid")
