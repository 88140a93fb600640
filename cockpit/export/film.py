"""A drive as a video: camera images with lanes, path, vehicle and people ahead, and the fear of each frame.

What is drawn comes from the very frame that is shown. The video runs at a constant rate on the clock of the drive;
an image is repeated until the next one.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cockpit.export.drive import STALE_S, Drive
from cockpit.export.frames import rate_of
from cockpit.footage.annotate import (
    HIGH,
    LEFT,
    LOW,
    PANEL,
    RIGHT,
    AnnotationWriter,
    enlarge,
    label,
    with_decision,
)
from cockpit.page.overlay import ahead_text, corners_px, overlay
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.topics import DECISION, LEAD_VEHICLE, ROAD_USERS, VEHICLE_STATE
from trepid.types import Image

PEOPLE = (77, 225, 255)
LANES = (LEFT, RIGHT, (255, 90, 255), HIGH)  # colours of the estimators


def write_film(drive: Drive, out: Path, rate_hz: float | None, done: Callable[[float], None]) -> int:
    """Write the video and return the number of its frames; ``done`` is called with the share that is written.

    Raises InputError when the recording holds no images.
    """
    if not drive.image_s:
        raise InputError(f"{drive.path}: holds no camera image, so there is no video of it")
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    fps = rate_of(drive.image_s) if rate_hz is None else rate_hz
    first_s, last_s = drive.image_s[0], max(drive.image_s)
    count, written = int((last_s - first_s) * fps + 1e-6) + 1, 0
    writer = AnnotationWriter(out, [drive.path])
    try:
        ahead = drive.images()
        coming = next(ahead, None)
        shown_s, canvas = first_s, None
        for number in range(count):
            at_s = first_s + number / fps
            latest = None
            while coming is not None and coming[0] <= at_s + 1e-6:
                latest, coming = coming, next(ahead, None)
            if latest is not None:
                shown_s, canvas = latest[0], draw_frame(drive, latest[0], latest[1], camera, vehicle)
            assert canvas is not None  # the first image is of first_s
            stamped = _draw_stamp(canvas, drive, at_s, at_s - shown_s)
            writer.write(stamped, drive.path, is_clip=True, fps=fps)
            written += 1
            done(written / count)
    finally:
        writer.close()
    return written


def draw_frame(drive: Drive, t_s: float, image: Image, camera: Camera, vehicle: Vehicle) -> Image:
    """The frame captured at ``t_s`` with what the nodes computed from it, at least 640 px wide."""
    canvas = enlarge(image)[0]
    estimates, decision = drive.estimates_from(t_s), drive.from_frame(DECISION, t_s)
    lead, people = drive.from_frame(LEAD_VEHICLE, t_s), drive.from_frame(ROAD_USERS, t_s)
    shapes = overlay(estimates.values(), decision, lead, camera, vehicle, people)
    scale = np.array([canvas.shape[1] / camera.width_px, canvas.shape[0] / camera.height_px])
    if shapes["path"]:
        tinted = canvas.copy()
        cv2.fillPoly(tinted, [_points(shapes["path"], scale)], HIGH, cv2.LINE_AA, 4)
        canvas = cv2.addWeighted(tinted, 0.45, canvas, 0.55, 0).astype(np.uint8, copy=False)
    for number, name in enumerate(drive.estimators):
        lane: dict[str, Any] = shapes["lanes"].get(name, {"left": (), "right": ()})
        for side in ("left", "right"):
            _line(canvas, lane[side], scale, LANES[number % len(LANES)])
    if shapes["lead"]:
        _line(canvas, corners_px(shapes["lead"]), scale, LOW, closed=True)
    for one in shapes["people"]:
        corners = corners_px(one["box"])
        _line(canvas, corners, scale, PEOPLE, closed=True)
        left, top = np.round(corners[0] * scale).astype(int).tolist()
        label(canvas, ahead_text(one["kind"], one["distance"]), (left, top), 0.36 * canvas.shape[1] / 640)
    return with_decision(canvas, decision, estimates)


def _line(
    canvas: Image,
    line: Iterable[Iterable[float]],
    scale: Any,
    colour: tuple[int, int, int],
    *,
    closed: bool = False,
) -> None:
    points = _points(line, scale)
    unit = max(1, round(canvas.shape[1] / 480))
    if len(points) > 1:
        cv2.polylines(canvas, [points], closed, PANEL, unit + 2, cv2.LINE_AA, 4)
        cv2.polylines(canvas, [points], closed, colour, unit, cv2.LINE_AA, 4)


def _points(line: Iterable[Iterable[float]], scale: Any) -> Any:
    """Points in sixteenths of a pixel of the canvas, shape (n, 2)."""
    return np.round(np.array(list(line), float).reshape(-1, 2) * scale * 16).astype(np.int32)


def _draw_stamp(canvas: Image, drive: Drive, at_s: float, age_s: float) -> Image:
    """A copy with the time, the speed and, where the image is old, its age."""
    state, copy = drive.newest(VEHICLE_STATE, at_s), canvas.copy()
    speed = "-" if state is None or state.speed_mps is None else f"{state.speed_mps:z.1f} m/s"
    old = f"   no image for {age_s:.1f} s" if age_s > STALE_S else ""
    unit = copy.shape[1] / 640
    label(copy, f"{at_s - drive.zero_s:.2f} s   {speed}{old}", (0, copy.shape[0]), 0.42 * unit)
    return copy
