"""``trepid fear explain RECORDING``: every slow-down of a drive, or the explanation of a moment, also as a figure.

The figure shows the camera image, the lane boundaries in it, and the rules that fired.
"""

import json
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import typer

from cockpit.logbook.recall import Recall, of_valid, recall
from cockpit.logbook.story import Story, overview, story
from cockpit.logbook.story_text import overview_text, story_text
from supervisor.rules.rule_file import LEVELS
from trepid.causes import concerning
from trepid.config import InputError
from trepid.images.figure_style import FEAR_COLOURS, estimator_colours, new_figure, save
from trepid.messages import SteeringEstimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_IN, PANEL_IN = 8.0, 1.6
SHOWN_RULES = 3
_WRAP = 124  # characters of a rule


@of_valid
def moment_figure(drive: Recall, story: Story) -> "Figure":
    """The moment that ``story`` explains. Raises InputError when no camera image of it was recorded."""
    index = int(np.argmin(np.abs(drive.t_s - story["moment_s"])))  # the story rounds the time
    frame = drive.frame_at(index)
    if frame is None:
        raise InputError(f"{drive.recorded.path}: no picture was recorded near {story['moment_s']:.1f} s")
    image = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{drive.recorded.path}: the picture near {story['moment_s']:.1f} s is no JPEG")
    height, width = image.shape[:2]
    image_in = WIDTH_IN * height / width
    figure = new_figure(WIDTH_IN, image_in + PANEL_IN)
    share = image_in / (image_in + PANEL_IN)
    camera = figure.add_axes((0.0, 1.0 - share, 1.0, share))
    camera.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), interpolation="bicubic", aspect="auto")
    estimates = drive.estimates_of(frame)
    for name, colour in estimator_colours(list(estimates)).items():
        _draw_lane(camera, estimates[name], name, colour)
    camera.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    camera.set_axis_off()
    if camera.get_legend_handles_labels()[0]:
        camera.legend(loc="upper left", fontsize=9, framealpha=1.0, edgecolor="white")
    _draw_panel(figure.add_axes((0.0, 0.0, 1.0, 1.0 - share)), story)
    return figure


def _draw_lane(axes: Any, estimate: SteeringEstimate, name: str, colour: str) -> None:
    """The boundaries of an estimate, on white so that they stand out on any road.

    Without boundaries, as of a network, the legend has no line for it.
    """
    reason = f", {estimate.reason}" if estimate.reason else ""
    boundaries = [b for b in (estimate.left_boundary_px, estimate.right_boundary_px) if len(b) > 1]
    label = f"{name}: confidence {estimate.confidence:.2f}{reason}"
    axes.plot([], [], color=colour if boundaries else "none", linewidth=3, label=label)
    for boundary in boundaries:
        x, y = np.array(boundary, float).T
        axes.plot(x, y, color="white", linewidth=4.5)
        axes.plot(x, y, color=colour, linewidth=2.5)


def _draw_panel(axes: Any, story: Story) -> None:
    """A bar as long as fear, mode and cause, and the rules that add most to fear."""
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.set_axis_off()
    axes.barh(0.96, min(story["fear"], 1.0), height=0.08, color=FEAR_COLOURS[LEVELS.index(story["level"])])
    cause = concerning(story["cause"], story["part"])
    what = f"{story['moment_s']:.2f} s   {story['mode']}   fear {story['fear']:.2f}, cause {cause}"
    axes.text(0.015, 0.74, what, fontsize=13, fontweight="bold", va="center")
    course = story.get("slow_down")
    fell = f"{course['cap_before_mps']:.1f} to {course['cap_lowest_mps']:.1f}" if course else None
    allowed = f"allowed {fell or format(story['speed_cap_mps'], '.1f')} m/s"
    axes.text(0.985, 0.74, allowed, fontsize=10, ha="right", va="center")
    for number, rule in enumerate(story["rules"][:SHOWN_RULES]):
        text = textwrap.shorten(f"{rule['adds']:.2f}  {rule['text']}", _WRAP, placeholder=" …")
        axes.text(0.015, 0.5 - 0.19 * number, text, fontsize=9, va="center")


MAGIC = b"\x89MCAP"


def is_recording(path: Path) -> bool:
    """Whether ``path`` is an MCAP file by its name or its first bytes."""
    if path.suffix == ".mcap":
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # the reader of rule files reports the error


def explain_drive(
    path: Path, at_s: float | None, *, rules: Path | None, picture: Path | None, as_json: bool
) -> bool:
    """Print the explanation of the moment ``at_s``, or all slow-downs; False when there is no slow-down to list.

    Raises InputError when ``path`` holds no decisions, or ``at_s`` is not in it.
    """
    drive = recall(path, rules)
    if at_s is None:
        return _list(drive, picture=picture, as_json=as_json)
    try:
        answer = story(drive, at_s)
    except ValueError as error:
        raise InputError(f"{path}: --at {at_s:g}: {error}") from error
    typer.echo(json.dumps(answer) if as_json else story_text(answer))
    if picture is not None:
        save(moment_figure(drive, answer), picture)
    return True


def _list(drive: Recall, *, picture: Path | None, as_json: bool) -> bool:
    if picture is not None:
        raise InputError(f"--picture {picture}: of which moment? Give --at")
    found = overview(drive)
    if as_json:
        for slow_down in found:
            typer.echo(json.dumps(slow_down))
    else:
        typer.echo(overview_text(drive.recorded, found))
    return bool(found)
