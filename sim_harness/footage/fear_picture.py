"""Frames with the lanes of all estimators, fear, level, cause and mode drawn into them."""

import cv2
import numpy as np

from perception.images.annotate import HIGH, LOW, MEDIUM, PANEL, WHITE, enlarged, text, with_lane
from perception.images.frames import FrameResult
from sim_harness.footage.onlooker import Onlooked
from trepid.messages import PixelPath, SteeringEstimate
from trepid.types import Image

DASHED = (255, 90, 255)  # an outline of assumed width
CALM, WORRIED = 0.35, 0.65  # fear at which the colour of the panel changes


def drawn(one: FrameResult[Onlooked]) -> Image:
    """The frame with both lanes and a strip with what the supervisor decided."""
    return panelled(with_lanes(one.image, one.result), one.result)


def with_lanes(image: Image, seen: Onlooked) -> Image:
    """A copy of ``image``, at least 640 px wide: measured boundaries as lines, those of assumed width dashed."""
    measured = [e for e in seen.estimates.values() if e.lane_width_m is not None]
    canvas = with_lane(image, measured[0]) if measured else enlarged(image)[0]
    scale = canvas.shape[1] / image.shape[1]
    for found in seen.estimates.values():
        if found.lane_width_m is None:
            dashed(canvas, found, scale)
    return canvas


def dashed(canvas: Image, estimate: SteeringEstimate, scale: float) -> None:
    """Draw the boundaries of ``estimate`` as dashes, fainter with less confidence."""
    unit = max(1, round(canvas.shape[1] / 480))
    fade = 0.35 + 0.65 * estimate.confidence
    colour = tuple(round(fade * channel) for channel in DASHED)
    for path in (estimate.left_boundary_px, estimate.right_boundary_px):
        for start, end in _dashes(path):
            a, b = (tuple(round(scale * value) for value in point) for point in (start, end))
            cv2.line(canvas, a, b, PANEL, 2 * unit + 2, cv2.LINE_AA)
            cv2.line(canvas, a, b, colour, 2 * unit, cv2.LINE_AA)


def _dashes(path: PixelPath) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The first half of every step of the path, from the bottom up."""
    points = np.array(path, float).reshape(-1, 2)
    middles = (points[:-1] + points[1:]) / 2
    return [(tuple(a), tuple(b)) for a, b in zip(points[:-1].tolist(), middles.tolist(), strict=True)]


def panelled(canvas: Image, seen: Onlooked) -> Image:
    """``canvas`` with a strip on top: fear as bar and number, level, cause, mode, confidences."""
    decision, width = seen.decision, canvas.shape[1]
    unit = width / 640
    strip = canvas[: round(46 * unit)]
    strip[:] = cv2.addWeighted(strip, 0.25, np.full_like(strip, PANEL), 0.75, 0)
    colour = HIGH if decision.fear < CALM else MEDIUM if decision.fear < WORRIED else LOW
    top, bottom, x, bar = round(24 * unit), round(36 * unit), round(12 * unit), round(98 * unit)
    text(canvas, "fear", (x, round(16 * unit)), 0.36 * unit, (190, 190, 190))
    cv2.rectangle(canvas, (x, top), (x + bar, bottom), (80, 80, 80), -1)
    cv2.rectangle(canvas, (x, top), (x + round(bar * decision.fear), bottom), colour, -1)
    text(canvas, f"{decision.fear:.2f}", (x + round(34 * unit), round(34.5 * unit)), 0.36 * unit, WHITE)
    sure = "  ".join(f"{name} {found.confidence:.2f}" for name, found in seen.estimates.items())
    shown = {"level": decision.level, "cause": decision.cause, "mode": str(decision.mode), "confidence": sure}
    for place, (name, value) in zip((122, 200, 365, 470), shown.items(), strict=True):
        text(canvas, name, (round(place * unit), round(16 * unit)), 0.36 * unit, (190, 190, 190))
        text(canvas, value, (round(place * unit), round(36 * unit)), 0.42 * unit, WHITE)
    return canvas
