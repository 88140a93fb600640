"""One pass over a sequence: rows and small pictures of the supervised estimators, or rows of other estimators.

The supervised car has the estimators of the default drive, and `segments` where the user has fetched its network.
"""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lab.bench.real import sets
from lab.bench.real.frames import Picture, estimates
from lab.bench.real.labels import SURFACES, Labels, Truth, border_error_px, columns, line_counts
from perception.estimators import ESTIMATORS, FURTHER
from perception.lane.outline import with_boundaries
from sim_harness.footage.fear_picture import with_lanes
from sim_harness.footage.onlooker import FrameJudgement, GivenSpeed, Onlooker
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.loudness import note
from trepid.messages import Frame, SteeringEstimate
from trepid.types import Array, Image, Mask

SEGMENTS = "segments"
SAY_EVERY_S = 20.0
GRID_PX = (96, 72)  # of a label in a row: width, height
LANE_ROWS = (0.95, 0.8, 0.65)  # where the place of a lane is kept, in heights of the image
TILE_WIDTH_PX = 400
Row = dict[str, Any]


def supervised_estimators() -> tuple[str, ...]:
    """Those of the default drive, and `segments` where its network is on this machine."""
    return (*ESTIMATORS, SEGMENTS) if FURTHER[SEGMENTS].is_here() else tuple(ESTIMATORS)


def look_at_frames(
    sequence: sets.Sequence, folder: Path, every: int, tiles: Path, names: Sequence[str], *, says: str
) -> Iterator[Row]:
    """A row of each frame of a car with the estimators ``names``; the frame with lanes goes to ``tiles``."""
    cv2.setNumThreads(1)
    tiles.mkdir(parents=True, exist_ok=True)
    drive = None
    for number, picture in enumerate(_report_progress(sequence.pictures(folder, every), says)):
        if picture.drive != drive:
            drive, onlooker = picture.drive, _onlooker(picture, sequence, names)
        seen = onlooker.step(Frame(t_s=picture.t_s, image=picture.image))
        cv2.imwrite(str(tiles / f"{number}.jpg"), _tile(picture.image, seen))
        yield _row(picture, seen, sequence.labels)


def answers(
    sequence: sets.Sequence, folder: Path, every: int, names: Sequence[str], *, says: str
) -> Iterator[dict[str, Row]]:
    """What the estimators ``names`` answer in each frame, without a supervisor."""
    cv2.setNumThreads(1)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for picture, found in estimates(_report_progress(sequence.pictures(folder, every), says), names):
        truth = _truth(picture, sequence.labels)
        yield {
            name: _answer(with_boundaries(one, picture.camera, vehicle), picture, sequence.labels, truth)
            for name, one in found.items()
        }


def _report_progress(pictures: Iterator[Picture], case: str) -> Iterator[Picture]:
    """``pictures``, with the progress on stderr."""
    said_s = time.monotonic()
    for number, picture in enumerate(pictures, start=1):
        yield picture
        if time.monotonic() - said_s > SAY_EVERY_S:
            said_s = time.monotonic()
            note(f"real: {case}, {number} frames")


def _onlooker(picture: Picture, sequence: sets.Sequence, names: Sequence[str]) -> Onlooker:
    """A fresh one. The speed is that of the picture's log, of the sequence, or the cruise speed of the settings."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    cruise_mps = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).cruise_speed_mps
    speed_mps = picture.speed_mps or sequence.speed_mps or cruise_mps
    state_of = GivenSpeed(picture.camera, vehicle, lambda _: speed_mps)
    return Onlooker(
        picture.camera, vehicle, state_of, cruise_speed_mps=speed_mps, names=names, assumed=picture.assumed
    )


def _row(picture: Picture, seen: FrameJudgement, labels: Labels) -> Row:
    decision, truth = seen.decision, _truth(picture, labels)
    row: Row = {"file": picture.file, "drive": picture.drive, "t_s": picture.t_s}
    row |= {"fear": decision.fear, "cause": decision.cause, "mode": str(decision.mode)}
    row["steering_rad"] = picture.steering_rad
    if truth is not None:
        row |= {"label": pack_mask(truth[0]), "known": pack_mask(truth[1])}
    row["estimates"] = {
        name: _answer(found, picture, labels, truth) for name, found in seen.estimates.items()
    }
    return row


def _truth(picture: Picture, labels: Labels) -> Truth | None:
    return SURFACES[labels](picture) if labels in SURFACES else None


def _answer(found: SteeringEstimate, picture: Picture, labels: Labels, truth: Truth | None) -> Row:
    """Confidence, angle, width and place of the lane, and its agreement with the label."""
    height, width = picture.image.shape[:2]
    places = lane_at(found, np.array(LANE_ROWS) * height) / width
    row: Row = {"confidence": found.confidence, "angle_rad": found.road_wheel_angle_rad}
    row["width_m"] = found.lane_width_m
    row["lane"] = [[None if np.isnan(x) else round(float(x), 4) for x in side] for side in places]
    if truth is None:
        return row | {"answered": bool(found.left_boundary_px and found.right_boundary_px)}
    if labels is Labels.LINES:
        row |= line_counts(picture, found)
    if labels is Labels.ROAD:
        row["border_error_px"] = border_error_px(found, truth[0])
    mine, (surface, known) = lane_mask(found, height, width), truth
    good = (mine & surface & known).sum()
    return row | {
        "answered": bool(mine.any()),
        "iou": float(good / max(((mine | surface) & known).sum(), 1)),
        "inside": float(good / max((mine & known).sum(), 1)),
    }


def pack_mask(mask: Mask) -> str:
    """A mask on the grid of a row, as hexadecimal digits."""
    small = cv2.resize(mask.astype(np.uint8), GRID_PX, interpolation=cv2.INTER_NEAREST)
    return np.packbits(small.astype(bool)).tobytes().hex()


def lane_at(found: SteeringEstimate, rows: Array) -> Array:
    """Columns of the left and the right boundary at ``rows``, shape (2, n); NaN where unknown."""
    return np.array([columns(path, rows) for path in (found.left_boundary_px, found.right_boundary_px)])


def lane_mask(found: SteeringEstimate, height: int, width: int) -> Mask:
    """Pixels between both boundaries, row by row."""
    left, right = lane_at(found, np.arange(height, dtype=float))
    at = np.arange(width)
    with np.errstate(invalid="ignore"):  # NaN: not between
        return np.asarray((at >= np.floor(left)[:, None]) & (at <= right[:, None]))


def _tile(image: Image, seen: FrameJudgement) -> Image:
    canvas = with_lanes(image, seen)
    height = round(canvas.shape[0] * TILE_WIDTH_PX / canvas.shape[1])
    return cv2.resize(canvas, (TILE_WIDTH_PX, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
