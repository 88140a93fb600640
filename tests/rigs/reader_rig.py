"""What readers of the pages have in their folder, made small."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from chessboard_rig import FISHEYE_POSES, POSES, draw_board
from drive_rig import write_table, write_tub, write_udacity
from rc_rig import FLAT
from short_form_rig import TRUTH
from wheel_rig import Installation

from perception.segments.settings import network_description
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.types import Image

FRAMES, RATE_HZ = 120, 20.0
CAMERA_INFO = """
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [431, 0, 318, 0, 433, 243, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def bring_files(reader: Installation) -> None:
    """What no command of Trepid writes: photographs, chessboards, a tub, logs, a film, files of other programs."""
    work = reader.work
    for folder, poses in (("boards", POSES), ("fisheye", FISHEYE_POSES)):
        (work / folder).mkdir()
        for number, pose in enumerate(poses):
            image = draw_board(*pose, fisheye=folder == "fisheye")
            cv2.imwrite(str(work / folder / f"{number}.png"), image)
    write_tub(work / "tub", frames=300, speeds_mps=np.full(300, 3.0))
    write_tub(work / "few-tub", frames=40)
    frames = list(road_frames())
    for name in ("road.jpg", "street.jpg"):
        cv2.imwrite(str(work / name), frames[0])
    write_udacity(work, frames=FRAMES)
    images = sorted(path.relative_to(work).as_posix() for path in (work / "IMG").iterdir())
    simulated = load(CONFIG_DIR / "cameras" / "udacity_sim_half.yaml", Camera)
    for name, frame in zip(images, frames, strict=True):
        cv2.imwrite(str(work / name), cv2.resize(frame, (simulated.width_px, simulated.height_px)))
    times_s = [number / RATE_HZ for number in range(FRAMES)]
    write_table(
        work, {"when": times_s, "image": images, "steering": [0.0] * FRAMES, "speed_mps": [3.0] * FRAMES}
    )
    write_udacity(work / "log", frames=120, sides=True)
    (reader.home / "mycar").mkdir()
    (reader.home / "mycar" / "myconfig.py").write_text(FLAT)
    write_film(work / "film.mp4", frames)
    write_masks(work / "best.onnx")
    write_trunk(work / "inception_v3.pth")
    (work / "camera_info.yaml").write_text(CAMERA_INFO)


def road_frames() -> Iterator[Image]:
    """Six seconds of a straight road at 8 m/s from the middle of the lane, 20 frames a second."""
    street, camera = load_road("straight"), load(CONFIG_DIR / "camera.yaml", Camera)
    renderer = Renderer(street, camera, seed=0)
    for frame in range(FRAMES):
        station_m = 20.0 + 8.0 * frame / RATE_HZ
        pose = (*street.position(station_m, 0.0), street.heading_at(station_m))
        yield renderer.render(*pose, t_s=frame / RATE_HZ, station_m=station_m)


def write_film(path: Path, frames: list[Image]) -> None:
    height_px, width_px = frames[0].shape[:2]
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (width_px, height_px))
    for frame in frames:
        film.write(frame)
    film.release()


def write_masks(path: Path) -> None:
    """TwinLiteNet with random weights, as the ONNX file of a network that is fetched."""
    import torch

    from learning.twinlitenet import PREFIX, TwinLiteNet, to_onnx

    checkpoint = path.with_suffix(".random")
    torch.manual_seed(5)
    torch.save({PREFIX + name: value for name, value in TwinLiteNet().state_dict().items()}, checkpoint)
    path.write_bytes(to_onnx(checkpoint.read_bytes(), network_description("twinlitenet"), "random"))
    checkpoint.unlink()


def write_trunk(path: Path) -> None:
    """The trunk of Inception v3 in the layout of the file that is downloaded, all zero: 95 MB less."""
    import torch

    from learning.models.imagenet import InceptionV3

    with torch.device("meta"):
        weights = InceptionV3().state_dict()
    torch.save(
        {name: torch.zeros((), dtype=one.dtype).expand(one.shape) for name, one in weights.items()}, path
    )


PREPARED = {
    "example copy config": "",
    "sim run glare --set duration_s=8 --record drive.mcap": "",
    "export drive.mcap clip.mp4": "",
    "sim run straight --set duration_s=20 --record straight.mcap": "",
    "sim run s_curve --set duration_s=30 --record bends.mcap": "",
    f"sim run s_curve {TRUTH}=60 --trace bends.npz": "",
    f"sim run straight {TRUTH}=4 --trace before.npz --json": "before.jsonl",
    "dataset build set tub": "",
    "dataset build few few-tub --gap-s 0.1": "",
    "train --data set --model donkey-linear --out F.onnx --set stages.0.epochs=1": "",
    "init mycar --like shuttle": "",
    "init myrc --like rc-car": "",
    "sim road export town town.xodr": "",
    "fear export config/fear.yaml": "f.fcl",
}
"""Command -> the file in which a reader keeps what it prints."""
COPIES = {
    "config/fear.yaml": ("F.yaml",),
    "before.npz": ("after.npz",),
    "before.jsonl": ("after.jsonl",),
    "f.fcl": ("rules.fcl",),
    "drive.mcap": ("glare.mcap", "before.mcap", "after.mcap", "before/drive.mcap", "after/drive.mcap"),
    "clip.mp4": ("VIDEO.mp4", "solidWhiteRight.mp4"),
    "set": ("tub-data", "drives", "lap"),
    "F.onnx": ("pilotnet.onnx", "donkey.onnx", "turn.onnx", "steer.onnx", "net.onnx"),
}


def prepare_files(reader: Installation) -> None:
    """What earlier commands wrote that a page supposes: recordings, data sets, networks, folders of cars."""
    for command, printed in PREPARED.items():
        done = reader.trepid(*command.split(), timeout_s=600)
        assert done.returncode in (0, 1), f"{command}: {done.stderr}"
        if printed:
            (reader.work / printed).write_text(done.stdout, encoding="utf-8")
    for source, names in COPIES.items():
        for name in names:
            (reader.work / name).parent.mkdir(exist_ok=True)
            copy = shutil.copytree if (reader.work / source).is_dir() else shutil.copy
            copy(reader.work / source, reader.work / name)
