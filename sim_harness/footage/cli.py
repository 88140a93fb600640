"""``trepid sim resimulate``: the stack in closed loop on recorded footage."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer

from cockpit.footage.api import brings_camera
from cockpit.footage.sources import RECORDING_SUFFIX, Source, Still, settings_of, sources
from perception.camera.self_calibration import CALIBRATION_FRAMES, calibrate_by_images
from perception.estimators import entry_of, lane_cv_settings
from sim_harness.footage.clip import ClipFrames, load_drive
from sim_harness.footage.reprojection import PoseChange, Reprojection
from sim_harness.footage.resimulation import SUPERVISED, Resimulation, resimulate
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.files import NOMINAL_FPS, write_image
from trepid.loudness import note
from trepid.options import Car

STARTS = ((0.5, 0.0), (-0.5, 0.0), (0.0, 2.0), (0.0, -2.0))  # m to the left, degrees to the left
MOST_OFFSET_M, MOST_HEADING_DEG = (
    1.0,
    10.0,
)  # beyond, an intervention comes at once, or few pixels were recorded
PICTURE_WIDTH_PX = 640


def resimulate_verb(
    clip: Annotated[
        Path, typer.Argument(help="A video, a recording (.mcap), or a folder of images in order of name.")
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            help="Camera file; default: that of the recording, else a typical one, self-calibrated."
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.5, max=60, help="Constant speed [m/s]; default: that of the recording."),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="CSV with t_s, speed_mps; or a Udacity driving_log.csv.")
    ] = None,
    scale: Annotated[
        float,
        typer.Option(min=0.01, max=100, help="Factor of the logged speed, for another scale of length."),
    ] = 1.0,
    offset: Annotated[
        float | None,
        typer.Option(min=-MOST_OFFSET_M, max=MOST_OFFSET_M, help="Start this far left of the path [m]."),
    ] = None,
    heading: Annotated[
        float | None,
        typer.Option(
            min=-MOST_HEADING_DEG, max=MOST_HEADING_DEG, help="Start with this heading, + = left [deg]."
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            help="Estimator of the car, or a driving network (.onnx); repeatable. Default: cv, cnn."
        ),
    ] = None,
    skip: Annotated[int, typer.Option(min=0, help="Number of first frames to skip.")] = 0,
    frames: Annotated[int | None, typer.Option(min=1, help="Largest number of frames.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write shifted views of one frame (.png).")] = None,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON Lines.")] = False,
) -> int:
    """Drive in closed loop on footage reprojected to the simulated car; exit code 1 after an intervention.

    Without --offset and --heading four runs start 0.5 m left and right, and turned 2 degrees left and right.
    """
    if speed is None and log is None and clip.suffix.lower() != RECORDING_SUFFIX:
        raise InputError(
            "the speed of the footage is missing: give --speed or --log, or both for another speed"
        )
    if scale != 1.0 and log is None:
        raise InputError("--scale: is a factor of the speed of --log, which is missing")
    estimators = tuple(dict.fromkeys(estimator or SUPERVISED))
    for name in estimators:
        entry_of(name)  # raises for an unknown name before the footage is read
    cv2.setNumThreads(1)
    given = load(camera, Camera) if camera else None
    source = sources(clip, drive_fps=NOMINAL_FPS)[0]
    with settings_of(source):
        assumed = given is None and not brings_camera(source)
        known = given or (assumed_camera(source) if assumed else load(CONFIG_DIR / "camera.yaml", Camera))
        drive = load_drive(clip, known, speed_mps=speed, log=log, scale=scale, skip=skip, most=frames)
        if picture is not None:
            _draw(drive, picture)
        starts = STARTS if offset is None and heading is None else ((offset or 0.0, heading or 0.0),)
        interventions = 0
        for row in _runs(drive, starts, estimators, assumed=assumed):
            interventions += row["interventions"]
            print(json.dumps(row) if as_json else _one_line(row), flush=True)
    return 1 if interventions else 0


def _runs(
    drive: ClipFrames, starts: tuple[tuple[float, float], ...], estimators: tuple[str, ...], *, assumed: bool
) -> Iterator[dict[str, Any]]:
    """The run without a shift, then those of ``starts``, compared with it."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    unshifted: Resimulation | None = None
    for left_m, heading_deg in ((0.0, 0.0), *starts):
        start = PoseChange(left_m=left_m, yaw_rad=math.radians(heading_deg))
        run = resimulate(drive, vehicle, start=start, estimators=estimators, assumed=assumed)
        unshifted = unshifted or run
        returned_s = run.return_s(unshifted)
        yield {
            "clip": drive.name,
            **run.row(),
            "return_s": None if returned_s is None else round(returned_s, 2),
        }


def assumed_camera(source: Source) -> Camera:
    """A typical camera with the horizon of the clip, as in `trepid estimate`."""
    note("no --camera given: distances depend on an assumed camera with the horizon of the clip")
    images = [source.read()] if isinstance(source, Still) else source.sample(CALIBRATION_FRAMES)
    return calibrate_by_images(images, lane_cv_settings().self_calibration)


def _draw(drive: ClipFrames, path: Path) -> None:
    """Draw the middle frame 0.5 m left, as recorded, 0.5 m right; 2 degrees left, 1 m left, 2 degrees right."""
    reprojection, frame = Reprojection(drive.camera), drive.frames[len(drive.frames) // 2]
    turn = math.radians(2.0)
    shifts = [
        [PoseChange(left_m=0.5), PoseChange(), PoseChange(left_m=-0.5)],
        [PoseChange(yaw_rad=turn), PoseChange(left_m=1.0), PoseChange(yaw_rad=-turn)],
    ]
    rows = [np.hstack([reprojection.view(frame, shift)[0] for shift in row]) for row in shifts]
    sheet = np.vstack(rows)
    scale = min(1.0, 3 * PICTURE_WIDTH_PX / sheet.shape[1])
    small = cv2.resize(sheet, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    write_image(path, np.asarray(small, np.uint8))


def _one_line(row: dict[str, Any]) -> str:
    returned = "never" if row["return_s"] is None else f"after {row['return_s']:.1f} s"
    share = row["autonomy_percent"]
    autonomy = "none" if share is None else f"{share:.1f} %"
    return (
        f"{row['clip']} from {row['start_offset_m']:+z.2f} m {math.degrees(row['start_heading_rad']):+z.1f}°:"
        f" {row['duration_s']:.1f} s, back {returned}, end at {row['end_offset_m']:+z.2f} m from the recorded path,"
        f" engaged {row['engaged_percent']:.0f} %, {row['interventions']} interventions, autonomy {autonomy},"
        f" fear {row['mean_fear']:.2f} (at most {row['max_fear']:.2f}),"
        f" lane found {row['lane_seen_percent']:.0f} %, unrecorded pixels {row['mean_unseen_percent']:.1f} %"
        f" (at most {row['max_unseen_percent']:.1f} %)"
    )
