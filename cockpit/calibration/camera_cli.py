"""``trepid camera``: calibration of a camera file."""

import json
import math
import re
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from cockpit.calibration.camera_info import describe, import_camera
from cockpit.calibration.chessboard import Intrinsics, intrinsics
from cockpit.calibration.drive_clip import steps_of
from cockpit.calibration.height import Step
from cockpit.calibration.straight_drive import Mounting, mounting
from cockpit.calibration.winding_drive import DriveMeasurement, camera_by_driving, recorded_frames
from cockpit.footage.sources import Clip, Still, sources
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.options import Car
from trepid.types import Image
from vehicle.cameras.working import Mount

MIN_SPEED_MPS = 1.0
MIN_WIDTH_PX, MAX_WIDTH_PX = 64, 8192
MAX_BOARDS = 60  # of a video
SAME_RATIO = 0.01  # tolerance of width over height
LENS_REPORT = ("boards", "left_out", "reprojection_px", "focal_doubt", "cover")
DRIVE_REPORT = ("pairs", "focal_doubt", "height_doubt")
MOUNTING_REPORT = ("frames", "sway_rad", "height_from", "height_doubt")
app = typer.Typer(no_args_is_help=True)


@app.callback()
def camera() -> None:
    """Calibrate a camera."""


Width = Annotated[
    int | None,
    typer.Option(help="Width in px to which images are scaled while driving. Default: as they are."),
]
Out = Annotated[Path | None, typer.Option(help="Camera file to write. Default: print it.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON only.")]


@app.command()
def calibrate(
    boards: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[BOARD…]", help="Images, folders or videos of a chessboard, for the lens."),
    ] = None,
    corners: Annotated[str, typer.Option(help="Inner corners of the board, columns x rows.")] = "9x6",
    fisheye: Annotated[
        bool, typer.Option("--fisheye", help="The lens is a fisheye: straight lines are clearly bent.")
    ] = False,
    straight: Annotated[
        Path | None,
        typer.Option(
            help="Video, folder or recording (.mcap) of driving straight in a lane, for the mounting."
        ),
    ] = None,
    drive: Annotated[
        Path | None,
        typer.Option(
            help="Recording (.mcap) of an ordinary drive with bends, for the mounting, and for the focal length"
            " without a chessboard."
        ),
    ] = None,
    lane_width: Annotated[
        float | None,
        typer.Option(help="Width of that lane in m, between the middles of its lines; gives the height."),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Speed of that drive in m/s; gives the height. Recordings contain it."),
    ] = None,
    width: Width = None,
    rotate: Annotated[
        int, typer.Option(help="0, 90, 180 or 270: clockwise turn that makes the images upright.")
    ] = 0,
    mirror: Annotated[
        str,
        typer.Option(
            help="none, horizontal or vertical: how the images are mirrored before they are turned."
        ),
    ] = "none",
    camera: Annotated[
        Path, typer.Option(help="Camera file with the values that are not measured.")
    ] = CONFIG_DIR / "camera.yaml",
    out: Out = None,
    force: Force = False,
    car: Car = None,
    as_json: AsJson = False,
) -> None:
    """Measure a camera: lens and focal length from a chessboard, pitch, yaw and height from driving."""
    if not boards and straight is None and drive is None:
        raise InputError(
            "expected images of a chessboard, --straight with a clip of driving straight, or --drive with a"
            " recording"
        )
    if straight is not None and drive is not None:
        raise InputError("give --straight or --drive, not both")
    if straight is None and (lane_width is not None or speed is not None):
        name = "--speed" if lane_width is None else "--lane-width"
        raise InputError(f"{name}: is of the drive of --straight, which is missing")
    _check_options(out if not force else None, lane_width, speed, width)
    mount = _mount(rotate, mirror)
    start = load(camera, Camera)
    if fisheye and not boards:
        raise InputError("--fisheye: needs images of a chessboard")
    lens = intrinsics(_pictures(boards, mount), _corners(corners), fisheye=fisheye) if boards else None
    measured, notes, report = _measure_camera(start, lens, straight, mount, speed, lane_width)
    if drive is not None:
        found = _measure_by_drive(measured, drive, mount, lens_known=bool(boards))
        measured, notes["drive"] = found.camera, _drive_note(found)
        report["drive"] = {name: getattr(found, name) for name in DRIVE_REPORT}
    _write_camera(_scale_camera(measured, width), notes, report, out=out, as_json=as_json, verb="calibrate")


@app.command("import")
def import_(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="INFO.yaml",
            help="camera_info of ROS: a file of camera_calibration, or what ros2 topic echo prints.",
        ),
    ],
    width: Width = None,
    camera: Annotated[
        Path, typer.Option(help="Camera file with the mounting, which camera_info does not state.")
    ] = CONFIG_DIR / "camera.yaml",
    out: Out = None,
    force: Force = False,
    car: Car = None,
    as_json: AsJson = False,
) -> None:
    """Make a camera file of a camera_info of ROS: plumb_bob, rational_polynomial or equidistant."""
    _check_options(out if not force else None, None, None, width)
    found = import_camera(file, load(camera, Camera))
    notes = describe(found, file, camera)
    report = {"model": found.model, "fit_px": found.fit_px}
    _write_camera(_scale_camera(found.camera, width), notes, report, out=out, as_json=as_json, verb="import")


def _scale_camera(camera: Camera, width_px: int | None) -> Camera:
    """The camera of images that are scaled to ``width_px``; None: as they are."""
    if width_px is None:
        return camera
    return camera.resize(width_px, round(camera.height_px * width_px / camera.width_px))


def _write_camera(
    camera: Camera,
    notes: dict[str, str],
    report: dict[str, Any],
    *,
    out: Path | None,
    as_json: bool,
    verb: str,
) -> None:
    """Write the camera file, and print it, its JSON, or the notes."""
    text = camera_yaml(camera, notes, verb=verb)
    if out is not None:
        _write(out, text)
    if as_json:
        print(json.dumps({"camera": camera.model_dump(mode="json"), **report}))
    else:
        print(text if out is None else "\n".join([f"{out} written", *notes.values(), ""]), end="")


def _check_options(
    fresh: Path | None, lane_width_m: float | None, speed_mps: float | None, width_px: int | None
) -> None:
    """Raise InputError for a number outside its range, or where the file ``fresh`` exists already."""
    if fresh is not None and fresh.exists():
        raise InputError(f"{fresh}: exists; --force overwrites it")
    for name, value, minimum in (("--lane-width", lane_width_m, 0.1), ("--speed", speed_mps, MIN_SPEED_MPS)):
        if value is not None and not (math.isfinite(value) and value >= minimum):
            raise InputError(f"{name}: must be a number of at least {minimum:g}, got {value}")
    if width_px is not None and not MIN_WIDTH_PX <= width_px <= MAX_WIDTH_PX:
        raise InputError(f"--width: must be {MIN_WIDTH_PX} to {MAX_WIDTH_PX}, got {width_px}")


def _measure_camera(
    camera: Camera,
    lens: Intrinsics | None,
    straight: Path | None,
    mount: Mount,
    speed_mps: float | None,
    lane_width_m: float | None,
) -> tuple[Camera, dict[str, str], dict[str, Any]]:
    """``camera`` with ``lens`` and the mounting of ``straight``; notes on both; their reports."""
    measured = camera
    notes: dict[str, str] = {}
    report: dict[str, Any] = {}
    if lens is not None:
        measured = _with_lens(measured, lens)
        notes["intrinsics"], report["intrinsics"] = _lens_note(lens), _fields(lens, LENS_REPORT)
    if straight is not None:
        steps = [_upright(step, mount) for step in steps_of(straight, speed_mps=speed_mps)]
        found = mounting(steps, _same_lens(measured, steps[0].image, straight), lane_width_m=lane_width_m)
        measured = measured.model_copy(update=_fields(found, ("pitch_down_rad", "yaw_rad", "height_m")))
        notes["extrinsics"], report["extrinsics"] = _mounting_note(found), _fields(found, MOUNTING_REPORT)
    return measured, notes, report


def _measure_by_drive(camera: Camera, path: Path, mount: Mount, *, lens_known: bool) -> DriveMeasurement:
    """``camera`` as the recorded drive measures it."""
    frames = (one._replace(image=mount.upright(one.image)) for one in recorded_frames(path))
    first = next(frames, None)
    if first is None:
        raise InputError(f"{path}: no camera frames in this recording")
    start = _same_lens(camera, first.image, path)
    return camera_by_driving(chain([first], frames), start, path, lens_known=lens_known)


def _fields(measured: Intrinsics | Mounting, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(measured, name) for name in names}


def _corners(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)x(\d+)", text.strip())
    if found is None or not all(3 <= int(count) <= 50 for count in found.groups()):
        raise InputError(f"--corners {text}: expected columns x rows of inner corners, such as 9x6")
    return int(found[1]), int(found[2])


def _mount(rotate_deg: int, mirror: str) -> Mount:
    try:
        return Mount.model_validate({"rotate_deg": rotate_deg, "mirror": mirror})
    except ValidationError as error:
        option = "--rotate" if error.errors()[0]["loc"] == ("rotate_deg",) else "--mirror"
        raise InputError(f"{option}: {error.errors()[0]['msg']}") from error


def _upright(step: Step, mount: Mount) -> Step:
    following = None if step.following is None else mount.upright(step.following)
    return replace(step, image=mount.upright(step.image), following=following)


def _pictures(paths: list[Path], mount: Mount) -> dict[str, Image]:
    """Upright images by name; of a video up to MAX_BOARDS frames, evenly spread."""
    pictures: dict[str, Image] = {}
    for path in paths:
        for source in sources(path):
            if isinstance(source, Still):
                pictures[str(source.path)] = source.read()
            elif isinstance(source, Clip):
                pictures |= {f"{source.path} {n}": image for n, image in enumerate(source.sample(MAX_BOARDS))}
    return {name: mount.upright(image) for name, image in pictures.items()}


def _same_lens(camera: Camera, image: Image, path: Path) -> Camera:
    """The camera at the size of the clip. Raises InputError for another aspect ratio."""
    height_px, width_px = image.shape[:2]
    if abs(width_px / height_px / (camera.width_px / camera.height_px) - 1) > SAME_RATIO:
        raise InputError(
            f"{path}: {width_px} x {height_px} px, but the camera file is for {camera.width_px} x"
            f" {camera.height_px}; give the right file with --camera, or images of a chessboard"
        )
    return camera.resize(width_px, height_px)


def _with_lens(camera: Camera, lens: Intrinsics) -> Camera:
    return camera.model_copy(
        update={
            "width_px": lens.size_px[0],
            "height_px": lens.size_px[1],
            "fx_px": round(float(lens.matrix[0, 0]), 2),
            "fy_px": round(float(lens.matrix[1, 1]), 2),
            "cx_px": round(float(lens.matrix[0, 2]), 2),
            "cy_px": round(float(lens.matrix[1, 2]), 2),
            "distortion": tuple(float(f"{value:.7g}") for value in lens.distortion),
        }
    )


def _lens_note(lens: Intrinsics) -> str:
    left_out = f", {len(lens.left_out)} left out" if lens.left_out else ""
    return (
        f"intrinsics: {len(lens.boards)} images of a chessboard{left_out}, rms {lens.reprojection_px:.2f} px,"
        f" focal length within {100 * lens.focal_doubt:.1f} %"
        + (", a fisheye" if lens.fisheye is not None else "")
    )


def _mounting_note(found: Mounting) -> str:
    doubt = "" if found.height_doubt is None else f" within {100 * found.height_doubt:.1f} %"
    return (
        f"mounting: {found.frames} frames of driving straight,"
        f" heading within {math.degrees(found.sway_rad):.1f}°; height from {found.height_from}{doubt}"
    )


def _drive_note(found: DriveMeasurement) -> str:
    lens = "" if found.focal_doubt is None else f"; focal length within {100 * found.focal_doubt:.1f} %"
    return (
        f"drive: {found.pairs} pairs of frames{lens}; height within {100 * found.height_doubt:.1f} %;"
        " distortion not measured"
    )


def camera_yaml(camera: Camera, notes: dict[str, str], *, verb: str = "calibrate") -> str:
    """The text of a camera file; ``notes`` are comments on the source of its values."""
    distortion = ", ".join(f"{value:.9g}" for value in camera.distortion)
    units = {"x_m": "ahead of the rear axle", "y_m": "+ = left", "yaw_rad": "+ = turned left"}
    lines = [f"# Written by trepid camera {verb}.", *(f"# {note}" for note in notes.values())]
    for name, value in camera.model_dump().items():
        shown = (
            f"[{distortion}]"
            if name == "distortion"
            else f"{round(value, 5):g}"
            if isinstance(value, float)
            else value
        )
        lines.append(f"{name}: {shown}" + (f"  # {units[name]}" if name in units else ""))
    return "\n".join(lines) + "\n"


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
