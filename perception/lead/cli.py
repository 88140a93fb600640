"""``trepid estimate --estimator lead``: the vehicles in images, folders and videos."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
from rich.console import Console
from rich.table import Table

from perception.images.annotate import PANEL, SURE, WHITE, AnnotationWriter, enlarged, text
from perception.images.sources import NOMINAL_FPS, VIDEO_SUFFIXES, Clip, Source, Still, sources
from perception.lead.detection import Detection
from perception.lead.finder import LeadFinder, LeadSettings, lead_settings, make_detector
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, LeadVehicle
from trepid.types import Image
from trepid.vehicle import Vehicle

CameraFor = Callable[[Source, Image], Camera]
OTHER = (190, 150, 60)
LEAD_STILL_CONFIDENCE = 0.5  # a single picture cannot confirm: from here on a detection counts as a vehicle


class SeenLead(NamedTuple):
    """One frame and what was found in it."""

    path: Path
    number: int
    image: Image
    camera: Camera
    lead: LeadVehicle
    detections: list[Detection]
    latency_ms: float


def estimate_leads(
    inputs: list[Path], camera_for: CameraFor, *, detector: Path | None, annotate: Path | None, as_json: bool
) -> None:
    """Find vehicles in every frame of every input. Raises InputError at the first input that is none."""
    settings = lead_settings()
    if detector is not None:
        settings = settings.model_copy(update={"detector": detector})
    seen = _seen(inputs, camera_for, settings)
    if annotate is not None:
        seen = _annotating(seen, annotate)
    (_print_json if as_json else _print_table)(seen)


def _seen(inputs: list[Path], camera_for: CameraFor, settings: LeadSettings) -> Iterator[SeenLead]:
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for path in inputs:
        for source in sources(path):
            yield from _source_seen(source, camera_for, settings, vehicle)


def _source_seen(
    source: Source, camera_for: CameraFor, settings: LeadSettings, vehicle: Vehicle
) -> Iterator[SeenLead]:
    """A still by itself, or a clip tracked by one finder; without odometry there are no speeds."""
    images = [source.read()] if isinstance(source, Still) else source.read()
    finder: LeadFinder | None = None
    for number, image in enumerate(images):
        if finder is None:
            camera = camera_for(source, image)
            finder = LeadFinder(make_detector(settings, camera), settings, camera, vehicle)
        t_s = number / source.fps if isinstance(source, Clip) else 0.0
        started_s = time.perf_counter()
        lead = finder.step(Frame(t_s=t_s, image=image), None, [], now_s=t_s)
        latency_ms = 1e3 * (time.perf_counter() - started_s)
        yield SeenLead(source.path, number, image, camera, lead, finder.detections, latency_ms)


def _annotating(seen: Iterator[SeenLead], out: Path) -> Iterator[SeenLead]:
    writer = AnnotationWriter(out, fps=NOMINAL_FPS)
    try:
        for one in seen:
            writer.write(drawn(one), one.path, is_clip=one.path.suffix.lower() in VIDEO_SUFFIXES)
            yield one
    finally:
        writer.close()


def drawn(seen: SeenLead) -> Image:
    """The frame with a box around each vehicle, its distance and how sure it is; the lead in green."""
    canvas, scale = enlarged(seen.image)
    unit = canvas.shape[1] / 640
    for detection in sorted(seen.detections, key=lambda d: -d.ahead_m):
        box = detection.pixels(seen.camera)
        if box is None or detection.confidence < LEAD_STILL_CONFIDENCE:
            continue
        left, top, right, bottom = (round(value * scale) for value in box)
        colour = SURE if _is_lead(detection, seen.lead) else OTHER
        cv2.rectangle(canvas, (left, top), (right, bottom), PANEL, 2 + max(1, round(unit)), cv2.LINE_AA)
        cv2.rectangle(canvas, (left, top), (right, bottom), colour, max(1, round(unit)), cv2.LINE_AA)
        label = f"{detection.ahead_m:.0f} m  {detection.confidence:.2f}"
        text(canvas, label, (left, max(top - round(4 * unit), round(12 * unit))), 0.4 * unit, WHITE)
    return canvas


def _is_lead(detection: Detection, lead: LeadVehicle) -> bool:
    if lead.lateral_m is None or lead.distance_m is None:
        return False
    return abs(detection.left_m - lead.lateral_m) < 1.0 and abs(detection.ahead_m - lead.distance_m) < 6.0


def _print_json(seen: Iterator[SeenLead]) -> None:
    for one in seen:
        print(json.dumps(as_row(one), allow_nan=False), flush=True)


def as_row(seen: SeenLead) -> dict[str, Any]:
    """The JSON object of one frame; places are metres from the rear axle, boxes left, top, right, bottom [px]."""
    return {
        "file": str(seen.path),
        "frame": seen.number,
        "estimator": "lead",
        "distance_m": seen.lead.distance_m,
        "lateral_m": seen.lead.lateral_m,
        "speed_mps": seen.lead.speed_mps,
        "confidence": seen.lead.confidence,
        "latency_ms": seen.latency_ms,
        "detections": [
            {
                "ahead_m": round(d.ahead_m, 2),
                "left_m": round(d.left_m, 2),
                "width_m": round(d.width_m, 2),
                "confidence": round(d.confidence, 3),
                "box_px": [round(value, 1) for value in d.pixels(seen.camera) or ()] or None,
            }
            for d in seen.detections
        ],
    }


def _print_table(seen: Iterator[SeenLead]) -> None:
    table = Table(box=None, header_style="bold")
    for name in ("file", "frame", "lead m", "left m", "conf.", "vehicles", "ms"):
        table.add_column(name, justify="left" if name == "file" else "right")
    try:
        for one in seen:
            lead = one.lead
            vehicles = sum(d.confidence >= LEAD_STILL_CONFIDENCE for d in one.detections)
            cells = ["-" if value is None else f"{value:.1f}" for value in (lead.distance_m, lead.lateral_m)]
            table.add_row(
                one.path.name,
                str(one.number),
                *cells,
                f"{lead.confidence:.2f}",
                str(vehicles),
                f"{one.latency_ms:.1f}",
            )
    finally:
        if table.row_count:
            Console(width=None if sys.stdout.isatty() else 200).print(table)
