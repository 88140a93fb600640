"""A moment of a recording as a picture: what the camera saw, where the lane was seen in it, what was feared."""

import cv2
import numpy as np

from cockpit.logbook.recall import Recall
from cockpit.logbook.story import Story
from cockpit.pictures import plot
from cockpit.pictures.plot import BLUE, FIVE, GREEN, ORANGE, PAPER, SCALE, SKY
from supervisor.rules.rule_file import LEVELS
from trepid.config import InputError
from trepid.messages import SteeringEstimate
from trepid.types import Image

WIDTH_PX, PANEL_PX = 640, 118
SHOWN_RULES = 3
_LINES = (BLUE, ORANGE, GREEN, SKY)  # of the estimators
_WRAP = 96  # characters of a rule


def moment_figure(drive: Recall, story: Story) -> Image:
    """The moment that ``story`` explains. Raises InputError when no picture of it was recorded."""
    index = drive.index_at(story["moment_s"])
    frame = drive.frame_at(index)
    if frame is None:
        raise InputError(f"{drive.recorded.path}: no picture was recorded near {story['moment_s']:.1f} s")
    image = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{drive.recorded.path}: the picture near {story['moment_s']:.1f} s is no JPEG")
    height = round(WIDTH_PX * image.shape[0] / image.shape[1])
    canvas = plot.blank(WIDTH_PX, height + PANEL_PX)
    canvas[: height * SCALE] = cv2.resize(
        image, (WIDTH_PX * SCALE, height * SCALE), interpolation=cv2.INTER_CUBIC
    )
    for number, (name, estimate) in enumerate(drive.estimates_of(frame).items()):
        _lane(canvas, estimate, WIDTH_PX / image.shape[1], number, name)
    _panel(canvas, story, height)
    return canvas


def _lane(canvas: Image, estimate: SteeringEstimate, scale: float, number: int, name: str) -> None:
    """The boundaries that an estimator saw, dark below light so that they stand out on any road."""
    colour = _LINES[number % len(_LINES)]
    for boundary in (estimate.left_boundary_px, estimate.right_boundary_px):
        if len(boundary) > 1:
            points = np.array(boundary, float) * scale
            plot.line(canvas, points, PAPER, width=4.0)
            plot.line(canvas, points, colour, width=2.4)
    x, y = 12.0, 22.0 + 20 * number
    told = f"{name}: confidence {estimate.confidence:.2f}" + (
        f", {estimate.reason}" if estimate.reason else ""
    )
    corner, end = (round((x - 6) * SCALE), round((y - 15) * SCALE)), x + 26 + plot.text_width(told)
    cv2.rectangle(canvas, corner, (round(end * SCALE), round((y + 5) * SCALE)), PAPER, -1)
    plot.line(canvas, np.array([[x, y - 4], [x + 14, y - 4]]), colour, width=3.0)
    plot.write(canvas, told, x + 20, y)


def _panel(canvas: Image, story: Story, top: int) -> None:
    level = LEVELS.index(story["level"]) if "level" in story else 0
    bar = round(WIDTH_PX * SCALE * min(story["fear"], 1.0))
    cv2.rectangle(canvas, (0, top * SCALE), (bar, (top + 8) * SCALE), FIVE[level], -1)
    what = f"{story['moment_s']:.2f} s   {story['mode']}   fear {story['fear']:.2f} of {story['cause']}"
    plot.write(canvas, what, 12, top + 32, size=16, bold=True)
    course = story["slow_down"]
    allowed = f"allowed {course['cap_before_mps']:.1f} to {course['cap_lowest_mps']:.1f} m/s"
    plot.write(canvas, allowed, WIDTH_PX - 12, top + 32, anchor="right")
    for number, rule in enumerate(story.get("rules", [])[:SHOWN_RULES]):
        text = f"{rule['adds']:.2f}  {rule['text']}"
        shown = text if len(text) <= _WRAP else text[: _WRAP - 1] + "…"
        plot.write(canvas, shown, 12, top + 58 + 20 * number, size=12)
