"""``trepid estimate``: run an estimator on images, folders and videos."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cockpit.footage.api import ASSUMED, cameras, check_estimator, find_leads
from cockpit.footage.api import estimate as estimates_of
from cockpit.footage.frames import FrameResult, Unread, show
from cockpit.footage.lane_rows import LANES
from cockpit.footage.leads import LEADS
from cockpit.footage.sources import is_recording
from perception.estimators import estimators
from perception.lead.finder import lead_settings
from trepid.config import InputError
from trepid.images.files import NOMINAL_FPS
from trepid.loudness import note
from trepid.messages import SteeringEstimate
from trepid.options import Car

LEAD, SEGMENTS = "lead", "segments"
NO_DETECTOR = (
    "vehicles ahead are left out: the embedded detector is trained on drawn vehicles; `trepid detector list` prints"
    " others for --detector or config/lead.yaml"
)


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
    _, assumed = cameras(camera)
    guessed = assumed and not all(map(is_recording, inputs))
    if guessed and (fear or estimator == LEAD):
        note(ASSUMED)
    unread = Unread(strict=strict)
    given: dict[str, Any] = {
        "camera": camera,
        "as_drive": drive,
        "fps": fps or NOMINAL_FPS,
        "unread": unread,
    }
    if fear:
        from sim_harness.footage.api import (
            estimators_to_rate,
            rate,
        )  # a tenth of a second, for this option only
        from sim_harness.footage.frame_fear import fears

        if lead_settings(detector).detector is None and not all(map(is_recording, inputs)):
            note(NO_DETECTOR)
        names = estimators_to_rate({estimator} - {LEAD})
        found = rate(inputs, names, speed_mps=speed, speeds=speeds, detector=detector, **given)
        show(found, fears(names), inputs, annotate=annotate, as_json=as_json)
    elif estimator == LEAD:
        show(find_leads(inputs, detector, **given), LEADS, inputs, annotate=annotate, as_json=as_json)
    else:
        lanes = estimates_of(inputs, estimator, **given)
        shown = _with_note(lanes, ASSUMED) if guessed else lanes
        sheet = LANES
        if estimator == SEGMENTS and annotate is not None:
            from cockpit.footage.masks import masks_and_lane

            sheet = replace(LANES, draw=masks_and_lane())
        show(shown, sheet, inputs, annotate=annotate, as_json=as_json)
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
