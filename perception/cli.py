"""``trepid estimate``: run an estimator on images, folders and videos."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from perception.api import ASSUMED, cameras, check_estimator, lane_results
from perception.estimators import ESTIMATORS, estimators
from perception.images.annotate import annotated, as_path, number
from perception.images.frames import FrameResult, Unread, print_json, print_table, written
from perception.images.sources import RECORDING_SUFFIX
from perception.lead.cli import estimate_leads
from trepid.commands.car_option import Car
from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS
from trepid.messages import SteeringEstimate
from trepid.speech.loudness import note

LEAD = "lead"
COLUMNS = [
    "file",
    "frame",
    "offset m",
    "heading °",
    "curv. 1/m",
    "wheel °",
    "width m",
    "lines",
    "conf.",
    "ms",
    "reason",
]


def estimate(
    inputs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="INPUT…", help="Images, folders of images, videos, recordings (.mcap)."),
    ] = None,
    estimator: Annotated[
        str,
        typer.Option(help="Name of the estimator, or a driving network (.onnx); 'list' prints all names."),
    ] = "cv",
    camera: Annotated[
        Path | None,
        typer.Option(help="Camera file; default: that of --car or of the recording, else an assumed one."),
    ] = None,
    detector: Annotated[
        Path | None,
        typer.Option(
            help="With --estimator lead or --fear: a name (`trepid detector list`), an .onnx or .tflite file."
        ),
    ] = None,
    fear: Annotated[
        bool,
        typer.Option(
            "--fear", help="Rate every frame with cv, cnn, --estimator, lead detector and supervisor."
        ),
    ] = False,
    speed: Annotated[
        float | None, typer.Option(min=0.0, max=60.0, help="--fear: constant speed of the car [m/s].")
    ] = None,
    speeds: Annotated[
        Path | None,
        typer.Option(metavar="LOG.csv", help="--fear: t_s, speed_mps and, if known, yaw_rate_radps by row."),
    ] = None,
    drive: Annotated[
        bool,
        typer.Option(
            "--drive",
            help="The images of a folder are one drive in natural order, whose frames are tracked; without it"
            " each image stands alone.",
        ),
    ] = False,
    fps: Annotated[
        float | None, typer.Option(min=0.1, max=1000.0, help="--drive: frames per second; default: 25.")
    ] = None,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="End with exit code 2 at an unreadable image of a folder; without it such images are named and"
            " left out, with exit code 1 at the end.",
        ),
    ] = False,
    car: Car = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object per frame on standard output.")
    ] = False,
    annotate: Annotated[
        Path | None, typer.Option(help="Write annotated frames: an image, an .mp4 file or a folder.")
    ] = None,
) -> int:
    """Estimate the lane, or find the vehicle ahead, in images, folders of images, videos and recordings."""
    if estimator == "list":
        _list_estimators(as_json)
        return 0
    check_estimator(estimator, LEAD)
    _check_options(estimator, fear=fear, detector=detector, speeds=(speed, speeds), drive=drive, fps=fps)
    if not inputs:
        raise InputError("name at least one image, folder or video")
    camera_for, assumed = cameras(camera)
    unread, drive_fps = Unread(strict=strict), (fps or NOMINAL_FPS) if drive else None
    guessed = assumed and not all(path.suffix.lower() == RECORDING_SUFFIX for path in inputs)
    if guessed and (fear or estimator == LEAD):
        note(ASSUMED)
    if fear:
        from sim_harness.footage.fear_cli import estimate_with_fear

        given = (assumed, speed, speeds, detector)
        names = tuple(dict.fromkeys((*ESTIMATORS, *({estimator} - {LEAD}))))
        estimate_with_fear(
            inputs, camera_for, unread, *given, names, drive_fps=drive_fps, annotate=annotate, as_json=as_json
        )
    elif estimator == LEAD:
        estimate_leads(
            inputs,
            camera_for,
            unread,
            drive_fps=drive_fps,
            detector=detector,
            annotate=annotate,
            as_json=as_json,
        )
    else:
        found = lane_results(inputs, estimator, camera, unread, drive_fps)
        if guessed:
            found = _with_note(found, ASSUMED)
        if annotate is not None:
            found = written(found, inputs, annotate, lambda one: annotated(one.image, one.result))
        if as_json:
            print_json(map(as_row, found))
        else:
            print_table(COLUMNS, {"file", "reason"}, map(_cells, found))
    return 1 if unread.count else 0


def _check_options(
    estimator: str,
    *,
    fear: bool,
    detector: Path | None,
    speeds: tuple[float | None, Path | None],
    drive: bool,
    fps: float | None,
) -> None:
    """Raise InputError for an option without the one that it belongs to."""
    if detector is not None and estimator != LEAD and not fear:
        raise InputError(f"--detector is an option of --estimator {LEAD} and of --fear")
    if not fear and speeds != (None, None):
        raise InputError("--speed and --speeds are options of --fear")
    if fps is not None and not drive:
        raise InputError("--fps is an option of --drive")


def _list_estimators(as_json: bool) -> None:
    """Print each estimator with its description and source."""
    lead = "the vehicle ahead: a small network, or a detector from a file"
    rows = [
        {"estimator": name, "description": entry.description, "source": entry.source, "stages": entry.stages}
        for name, entry in estimators().items()
    ]
    rows.append({"estimator": LEAD, "description": lead, "source": "config/lead.yaml", "stages": ()})
    width = max(len(str(row["estimator"])) for row in rows)
    for row in rows:
        if as_json:
            print(json.dumps(row))
            continue
        print(f"{row['estimator']:{width}} {row['description']}")
        print(f"{'':{width}}   {row['source']}" + (f": {' > '.join(row['stages'])}" if row["stages"] else ""))


def _with_note(
    found: Iterator[FrameResult[SteeringEstimate]], text: str
) -> Iterator[FrameResult[SteeringEstimate]]:
    """``found``, with the note ``text`` before the first frame."""
    for index, one in enumerate(found):
        if index == 0:
            note(text)
        yield one


def as_row(one: FrameResult[SteeringEstimate]) -> dict[str, Any]:
    """The JSON object of one frame."""
    return {"file": str(one.path), "frame": one.number, **estimate_fields(one.result, one.latency_ms)}


def estimate_fields(result: SteeringEstimate, latency_ms: float | None) -> dict[str, Any]:
    """The fields of an estimate in JSON; None where it has none."""
    return {
        "estimator": result.estimator,
        "lateral_offset_m": result.lateral_offset_m,
        "heading_error_rad": result.heading_error_rad,
        "curvature_1pm": result.curvature_1pm,
        "road_wheel_angle_rad": result.road_wheel_angle_rad,
        "confidence": result.confidence,
        "lanes_detected": result.lanes_detected,
        "lane_width_m": result.lane_width_m,
        "latency_ms": latency_ms,
        "reason": result.reason,
        "left_boundary_px": as_path(result.left_boundary_px) or None,
        "right_boundary_px": as_path(result.right_boundary_px) or None,
    }


def _cells(one: FrameResult[SteeringEstimate]) -> list[str]:
    result = one.result
    heading, wheel = result.heading_error_rad, result.road_wheel_angle_rad
    return [
        one.path.name,
        str(one.number),
        number(result.lateral_offset_m, "{:+z.2f}"),
        number(None if heading is None else math.degrees(heading), "{:+z.2f}"),
        number(result.curvature_1pm, "{:+z.4f}"),
        number(None if wheel is None else math.degrees(wheel), "{:+z.2f}"),
        number(result.lane_width_m, "{:z.2f}"),
        str(result.lanes_detected),
        f"{result.confidence:z.2f}",
        number(one.latency_ms, "{:z.1f}"),
        result.reason,
    ]
