"""The vehicles and people in images, folders and videos, and their rows."""

import math
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2

from cockpit.footage.annotate import HIGH, PANEL, enlarge, label
from cockpit.footage.frames import (
    CameraFor,
    FrameResult,
    Sheet,
    Step,
    Unread,
    results,
)
from cockpit.footage.sources import Source
from perception.lead.detection import Detection
from perception.lead.finder import LeadFinder, LeadSettings, lead_finder, lead_settings
from perception.lead.kinds import VEHICLE
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.loudness import note
from trepid.messages import Frame, LeadVehicle
from trepid.types import Image

SAME_LEFT, SAME_AHEAD = 0.7, 4.0  # heights of a vehicle between a leader, from the bumper, and its detection
OTHER = (190, 150, 60)
LEAD_STILL_CONFIDENCE = (
    0.5  # a still cannot be confirmed by the next frame: least confidence of a vehicle in it
)
COLUMNS = ("file", "frame", "lead m", "left m", "conf.", "vehicles", "people", "ms")


class Leads(NamedTuple):
    """The vehicles and other road users in one frame, in the world of the car."""

    lead: LeadVehicle
    detections: list[Detection]


def lead_results(
    inputs: Iterable[Path],
    camera_for: CameraFor,
    unread: Unread,
    detector: Path | None,
    *,
    drive_fps: float | None = None,
) -> Iterator[FrameResult[Leads]]:
    """The vehicles in every frame of every input. Raises InputError."""
    step = partial(_step, lead_settings(detector))
    return results(inputs, camera_for, step, unread, drive_fps=drive_fps)


def _step(settings: LeadSettings, source: Source, camera: Camera) -> Step[Leads]:
    """A fresh finder."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    finder = lead_finder(settings, camera, vehicle)
    if settings.detector is not None:
        note(f"trepid: detector {finder.detector_text}")
    return partial(leads_in, finder, vehicle.scale)


def leads_in(finder: LeadFinder, scale: float, frame: Frame) -> Leads:
    """What ``finder`` finds in ``frame`` on a car of this scale; without odometry it measures no speeds."""
    lead = finder.step(frame, None, [], now_s=frame.t_s)
    return Leads(lead, [detection.scale(scale) for detection in finder.detections])


def draw_leads(one: FrameResult[Leads]) -> Image:
    """The frame with a box around each vehicle, its distance and confidence; the leader is green.

    The text of the leader stands above its box, that of others below, so that texts of neighbours do not overlap.
    """
    canvas, scale = enlarge(one.image)
    unit = canvas.shape[1] / 640
    labels: list[tuple[str, tuple[int, int]]] = []
    for detection in sorted(one.result.detections, key=lambda d: -d.ahead_m):
        box = detection.pixels(one.camera)
        if box is None or detection.confidence < LEAD_STILL_CONFIDENCE:
            continue
        left, top, right, bottom = (round(value * scale) for value in box)
        leads = detection.kind == VEHICLE and _is_lead(detection, one.result.lead)
        colour = HIGH if leads else OTHER
        cv2.rectangle(canvas, (left, top), (right, bottom), PANEL, 2 + max(1, round(unit)), cv2.LINE_AA)
        cv2.rectangle(canvas, (left, top), (right, bottom), colour, max(1, round(unit)), cv2.LINE_AA)
        name = "" if detection.kind == VEHICLE else f"{detection.kind}  "
        words = f"{name}{detection.ahead_m:z.0f} m  {detection.confidence:z.2f}"
        labels.append((words, (left, top - round(6 * unit) if leads else bottom + round(18 * unit))))
    for words, place in labels:
        label(canvas, words, place, 0.45 * unit)
    return canvas


def _is_lead(detection: Detection, lead: LeadVehicle) -> bool:
    if lead.lateral_m is None or lead.distance_m is None:
        return False
    beside_m, ahead_m = abs(detection.left_m - lead.lateral_m), abs(detection.ahead_m - lead.distance_m)
    return beside_m < SAME_LEFT * detection.height_m and ahead_m < SAME_AHEAD * detection.height_m


def as_row(one: FrameResult[Leads]) -> dict[str, Any]:
    """The JSON object of one frame; places are metres from the rear axle, boxes left, top, right, bottom [px]."""
    lead = one.result.lead
    return {
        "file": str(one.path),
        "frame": one.number,
        "estimator": "lead",
        "distance_m": lead.distance_m,
        "lateral_m": lead.lateral_m,
        "speed_mps": lead.speed_mps,
        "confidence": None if math.isnan(lead.confidence) else lead.confidence,
        "latency_ms": one.latency_ms,
        "detections": [
            {
                "kind": d.kind,
                "ahead_m": round(d.ahead_m, 2),
                "left_m": round(d.left_m, 2) + 0.0,  # never -0.0
                "width_m": round(d.width_m, 2),
                "confidence": round(d.confidence, 3),
                "box_px": [round(value, 1) for value in d.pixels(one.camera) or ()] or None,
            }
            for d in one.result.detections
        ],
    }


def _cells(one: FrameResult[Leads]) -> list[str]:
    lead, detections = one.result
    return [
        one.path.name,
        str(one.number),
        *("-" if value is None else f"{value:z.1f}" for value in (lead.distance_m, lead.lateral_m)),
        f"{lead.confidence:z.2f}",
        str(sum(d.confidence >= LEAD_STILL_CONFIDENCE and d.kind == VEHICLE for d in detections)),
        str(sum(d.confidence >= LEAD_STILL_CONFIDENCE and d.kind != VEHICLE for d in detections)),
        f"{one.latency_ms:z.1f}",
    ]


LEADS = Sheet(as_row=as_row, columns=COLUMNS, left={"file"}, cells=_cells, draw=draw_leads)
