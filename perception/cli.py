"""``trepid estimate``: run an estimator on images, folders and videos."""

import json
import math
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import cv2
import typer
from rich.console import Console
from rich.table import Table

from perception.camera.self_calibration import self_calibrated
from perception.estimators import ESTIMATORS, Estimator, entry_of, estimators, lane_cv_settings
from perception.images.annotate import AnnotationWriter, annotated, as_path
from perception.images.sources import NOMINAL_FPS, VIDEO_SUFFIXES, Clip, Source, Still, sources
from perception.lead.cli import estimate_leads
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, SteeringEstimate
from trepid.types import Image
from trepid.vehicle import Vehicle

Seen = tuple[Path, int, Image, SteeringEstimate]

CALIBRATION_FRAMES = 9
LEAD = "lead"
MAX_TABLE_WIDTH = 200
ASSUMED = "no --camera given: metres rest on an assumed camera, its horizon found in each image or clip"


def estimate(
    inputs: Annotated[
        list[Path] | None, typer.Argument(metavar="INPUT…", help="Images, folders, videos.")
    ] = None,
    estimator: Annotated[str, typer.Option(help="Which estimator; 'list' shows all.")] = "cv",
    camera: Annotated[
        Path | None, typer.Option(help="Camera file; without it a typical one is assumed.")
    ] = None,
    detector: Annotated[
        Path | None, typer.Option(help="With --estimator lead: an .onnx or .tflite box detector to use.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object per frame on standard output.")
    ] = False,
    annotate: Annotated[
        Path | None, typer.Option(help="Write annotated frames: an image, an .mp4 file or a folder.")
    ] = None,
) -> None:
    """Estimate the lane, or find the vehicle ahead, in images, folders of images and videos."""
    if estimator == "list":
        _list_estimators(as_json)
        return
    if estimator not in (*ESTIMATORS, LEAD) and estimator not in estimators():
        raise InputError(f"no estimator {estimator!r}; there are {', '.join((*estimators(), LEAD))}")
    if detector is not None and estimator != LEAD:
        raise InputError(f"--detector is for --estimator {LEAD}")
    if not inputs:
        raise InputError("name at least one image, folder or video")
    cv2.setNumThreads(1)
    os.environ.setdefault(
        "OPENCV_FFMPEG_LOGLEVEL", "-8"
    )  # quiet: a broken video is reported in our own words
    known = load(camera, Camera) if camera else None
    if estimator == LEAD:
        if known is None:
            print(ASSUMED, file=sys.stderr)
        eyes = partial(_camera_for, known=known)
        estimate_leads(inputs, eyes, detector=detector, annotate=annotate, as_json=as_json)
        return
    seen = _seen(inputs, estimator, known)
    if known is None:
        seen = _telling(seen, ASSUMED)
    if annotate is not None:
        seen = _annotating(seen, annotate)
    (_print_json if as_json else _print_table)(seen)


def _list_estimators(as_json: bool) -> None:
    """What each is and where it comes from."""
    lead = "vehicles, and the one ahead of us: a small network, or a detector from a file"
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


def _seen(inputs: list[Path], name: str, known: Camera | None) -> Iterator[Seen]:
    """Every frame of every input with its estimate. Raises InputError at the first input that is none."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for path in inputs:
        for source in sources(path):
            yield from _source_seen(source, name, known, vehicle)


def _source_seen(source: Source, name: str, known: Camera | None, vehicle: Vehicle) -> Iterator[Seen]:
    """A still by itself with a fresh estimator, or a clip tracked by one."""
    images = [source.read()] if isinstance(source, Still) else source.read()
    runner: Estimator | None = None
    for number, image in enumerate(images):
        if runner is None:
            camera = _camera_for(source, image, known)
            runner = entry_of(name).build(camera, vehicle)
        t_s = number / source.fps if isinstance(source, Clip) else 0.0
        started_s = time.perf_counter()
        result = runner.step(Frame(t_s=t_s, image=image), None, now_s=t_s)
        latency_ms = 1e3 * (time.perf_counter() - started_s)
        yield source.path, number, image, replace(result, latency_ms=latency_ms)


def _camera_for(source: Source, image: Image, known: Camera | None) -> Camera:
    """The given camera at the size of the image, or an assumed one with the horizon of the image or clip."""
    if known is not None:
        return known.resized(image.shape[1], image.shape[0])
    images = [image] if isinstance(source, Still) else source.sample(CALIBRATION_FRAMES)
    return self_calibrated(images, lane_cv_settings().self_calibration)


def _telling(seen: Iterator[Seen], note: str) -> Iterator[Seen]:
    """Pass ``seen`` on, with ``note`` on standard error before the first frame, if there is one."""
    for number, one in enumerate(seen):
        if number == 0:
            print(note, file=sys.stderr)
        yield one


def _annotating(seen: Iterator[Seen], out: Path) -> Iterator[Seen]:
    """Pass ``seen`` on and write its annotated frames."""
    writer = AnnotationWriter(out, fps=NOMINAL_FPS)
    try:
        for path, number, image, result in seen:
            writer.write(annotated(image, result), path, is_clip=path.suffix.lower() in VIDEO_SUFFIXES)
            yield path, number, image, result
    finally:
        writer.close()


def _print_json(seen: Iterator[Seen]) -> None:
    for path, number, _, result in seen:
        print(json.dumps(as_row(path, number, result), allow_nan=False), flush=True)


def as_row(path: Path, number: int, result: SteeringEstimate) -> dict[str, Any]:
    """The JSON object of one frame."""
    return {
        "file": str(path),
        "frame": number,
        "estimator": result.estimator,
        "lateral_offset_m": result.lateral_offset_m,
        "heading_error_rad": result.heading_error_rad,
        "curvature_1pm": result.curvature_1pm,
        "road_wheel_angle_rad": result.road_wheel_angle_rad,
        "confidence": result.confidence,
        "lanes_detected": result.lanes_detected,
        "lane_width_m": result.lane_width_m,
        "latency_ms": result.latency_ms,
        "reason": result.reason,
        "left_boundary_px": as_path(result.left_boundary_px) or None,
        "right_boundary_px": as_path(result.right_boundary_px) or None,
    }


def _print_table(seen: Iterator[Seen]) -> None:
    """One line per frame; what was seen before an error is printed all the same."""
    table = Table(box=None, header_style="bold")
    for name in ("file", "frame", "offset m", "heading °", "curv. 1/m", "wheel °", "width m", "lines"):
        table.add_column(name, justify="left" if name == "file" else "right")
    for name in ("conf.", "ms", "reason"):
        table.add_column(name, justify="left" if name == "reason" else "right")
    try:
        for path, number, _, result in seen:
            table.add_row(*_cells(path, number, result))
    finally:
        if table.row_count:
            # Into a file or a pipe nothing is cut off.
            Console(width=None if sys.stdout.isatty() else MAX_TABLE_WIDTH).print(table)


def _cells(path: Path, number: int, result: SteeringEstimate) -> list[str]:
    heading, wheel = result.heading_error_rad, result.road_wheel_angle_rad
    return [
        path.name,
        str(number),
        _number(result.lateral_offset_m, "+.2f"),
        _number(None if heading is None else math.degrees(heading), "+.2f"),
        _number(result.curvature_1pm, "+.4f"),
        _number(None if wheel is None else math.degrees(wheel), "+.2f"),
        _number(result.lane_width_m, ".2f"),
        str(result.lanes_detected),
        f"{result.confidence:.2f}",
        _number(result.latency_ms, ".1f"),
        result.reason,
    ]


def _number(value: float | None, pattern: str) -> str:
    return "-" if value is None else format(value, pattern)
