"""A strip on top of a picture: fear, level, cause and mode of a decision, confidences of estimates."""

from collections.abc import Mapping

import cv2
import numpy as np

from perception.images.annotate import HIGH, LOW, MEDIUM, PANEL, WHITE, text
from trepid.messages import Decision, SteeringEstimate
from trepid.types import Image

SOME_FROM, MUCH_FROM = 0.35, 0.65  # fear at which the colour of the strip changes


def with_decision(
    canvas: Image, decision: Decision | None, estimates: Mapping[str, SteeringEstimate]
) -> Image:
    """``canvas`` itself, with the strip drawn into it; dashes where there is no decision."""
    width = canvas.shape[1]
    unit = width / 640
    strip = canvas[: round(46 * unit)]
    strip[:] = cv2.addWeighted(strip, 0.25, np.full_like(strip, PANEL), 0.75, 0)
    top, bottom, x, bar = round(24 * unit), round(36 * unit), round(12 * unit), round(98 * unit)
    text(canvas, "fear", (x, round(16 * unit)), 0.36 * unit, (190, 190, 190))
    cv2.rectangle(canvas, (x, top), (x + bar, bottom), (80, 80, 80), -1)
    if decision is not None:
        colour = HIGH if decision.fear < SOME_FROM else MEDIUM if decision.fear < MUCH_FROM else LOW
        cv2.rectangle(canvas, (x, top), (x + round(bar * decision.fear), bottom), colour, -1)
    fear = "-" if decision is None else f"{decision.fear:.2f}"
    text(canvas, fear, (x + round(34 * unit), round(34.5 * unit)), 0.36 * unit, WHITE)
    names = ("level", "cause", "mode")
    shown = {name: "-" if decision is None else str(getattr(decision, name)) for name in names}
    shown["confidence"] = "  ".join(f"{name} {found.confidence:.2f}" for name, found in estimates.items())
    for place, (name, value) in zip((122, 200, 365, 470), shown.items(), strict=True):
        text(canvas, name, (round(place * unit), round(16 * unit)), 0.36 * unit, (190, 190, 190))
        text(canvas, value, (round(place * unit), round(36 * unit)), 0.42 * unit, WHITE)
    return canvas
