"""Frames with the lanes of all estimators, fear, level, cause and mode drawn into them."""

import cv2
import numpy as np

from cockpit.footage.annotate import PANEL, enlarge, with_decision, with_lane
from cockpit.footage.frames import FrameResult
from sim_harness.footage.onlooker import FrameJudgement
from trepid.bounds import at_least
from trepid.messages import PixelPath, SteeringEstimate
from trepid.types import Image

DASHED = (255, 90, 255)  # an outline of a lane without detected boundaries


def draw_fear(one: FrameResult[FrameJudgement]) -> Image:
    """The frame with both lanes and a strip with what the supervisor decided."""
    return with_decision(with_lanes(one.image, one.result), one.result.decision, one.result.estimates)


def with_lanes(image: Image, seen: FrameJudgement) -> Image:
    """A copy of ``image``, at least 640 px wide: detected boundaries as lines, others dashed."""
    measured = [e for e in seen.estimates.values() if e.has_boundaries]
    canvas = with_lane(image, measured[0]) if measured else enlarge(image)[0]
    scale = canvas.shape[1] / image.shape[1]
    for found in seen.estimates.values():
        if not found.has_boundaries:
            draw_dashes(canvas, found, scale)
    return canvas


def draw_dashes(canvas: Image, estimate: SteeringEstimate, scale: float) -> None:
    """Draw the boundaries of ``estimate`` as dashes, fainter with less confidence."""
    unit = max(1, round(canvas.shape[1] / 480))
    fade = 0.35 + 0.65 * at_least(estimate.confidence, 0.0)
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
