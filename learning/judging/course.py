"""Recorded and predicted angles of one model over time, and one against the other.

An error of the mean hides its kind. Over time a late, a weak and a noisy prediction look different; in the scatter
a weak one is flatter than the identity, and a constant one is level.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import Rows, pieces_of
from learning.judging.scores import Angles
from trepid.images.figure_style import BLUE, DPI, FAINT, GREY, INK, ORANGE, VERMILION, bare, new_figure
from trepid.types import Column, Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STRIP_S = 45.0  # driving in one strip, until there are MOST_STRIPS
MOST_STRIPS = 6
STRIP_IN, LEAST_HEIGHT_IN = 1.5, 3.6
NAMED = 5  # frames with their rank in the scatter, where more would cover each other
SPREAD = 1.06  # of the axes of the angle, over the greatest angle


def driving_time_s(rows: Rows) -> Column:
    """Time of driving [s] at each of ``rows`` since the first one, without what lies between pieces of a drive.

    A new piece begins one median period after the end of the last.
    """
    if not len(rows):
        return np.empty(0)
    step_s = np.diff(rows["t_s"])
    follows = (np.diff(pieces_of(rows)) == 0) & (step_s > 0)
    usual_s = float(np.median(step_s[follows])) if follows.any() else 0.0
    return np.concatenate([[0.0], np.cumsum(np.where(follows, step_s, usual_s))])


def course_figure(
    rows: Rows,
    true_deg: Angles,
    predicted_deg: Angles,
    half_width_deg: Angles,
    *,
    worst: Sequence[int] = (),
    wheel: str = "road wheel",
    width_in: float = 10.0,
) -> "Figure":
    """Strips of both angles over the time of driving, and beside them the scatter with the identity.

    ``half_width_deg``: of the stated 90 % interval, (n,), NaN without one. ``worst``: numbers of rows that get a
    mark with their rank. Frames without a prediction are gaps. Lines end where a piece of a drive ends.
    """
    time_s = driving_time_s(rows)
    whole_s = max(float(time_s[-1]), 1e-9)
    strips = min(MOST_STRIPS, max(1, int(np.ceil(whole_s / STRIP_S))))
    height_in = max(LEAST_HEIGHT_IN, STRIP_IN * strips)
    figure = new_figure(width_in, height_in, layout="constrained")
    grid = figure.add_gridspec(strips, 2, width_ratios=(2.2, 1.0))
    known = np.concatenate([true_deg, predicted_deg[np.isfinite(predicted_deg)]])
    most_deg = SPREAD * max(float(np.abs(known).max()), 0.5)
    place = time_s, true_deg, predicted_deg, half_width_deg
    starts = np.flatnonzero(np.diff(pieces_of(rows))) + 1
    for strip in range(strips):
        axes = figure.add_subplot(grid[strip, 0])
        _draw_strip(axes, place, starts)
        _mark(axes, time_s, predicted_deg, worst)
        axes.set(xlim=(strip * whole_s / strips, (strip + 1) * whole_s / strips), ylim=(-most_deg, most_deg))
        bare(axes)
        if strip == 0:
            axes.legend(
                frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8, borderpad=0.1
            )
    axes.set_xlabel("time of driving [s]")
    figure.supylabel(f"angle of the {wheel} [°], + = left", fontsize=9)
    _draw_scatter(figure.add_subplot(grid[:, 1]), true_deg, predicted_deg, worst, most_deg)
    return figure


def _draw_strip(axes: Any, place: tuple[Column, Angles, Angles, Angles], starts: NDArray[np.intp]) -> None:
    """Both angles over the whole time; NaN where a piece of a drive ends."""
    time_s, true_deg, predicted_deg, width_deg = (np.insert(one, starts, np.nan) for one in place)
    if np.isfinite(width_deg).any():
        low, high = predicted_deg - width_deg, predicted_deg + width_deg
        axes.fill_between(time_s, low, high, color=ORANGE, alpha=0.25, linewidth=0, label="90 % interval")
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.plot(time_s, true_deg, color=INK, linewidth=1.2, label="recorded")
    axes.plot(time_s, predicted_deg, color=ORANGE, linewidth=0.9, label="predicted")


def _mark(axes: Any, at: Column, values: Column, worst: Sequence[int]) -> None:
    for rank, number in enumerate(worst, 1):
        axes.plot(at[number], values[number], "o", color=VERMILION, markersize=2.5)
        axes.annotate(
            str(rank),
            (at[number], values[number]),
            xytext=(2, 2),
            textcoords="offset points",
            fontsize=6,
            color=VERMILION,
            annotation_clip=True,
        )


def _draw_scatter(
    axes: Any, true_deg: Angles, predicted_deg: Angles, worst: Sequence[int], most_deg: float
) -> None:
    axes.plot([-most_deg, most_deg], [-most_deg, most_deg], color=GREY, linewidth=0.8)
    axes.plot(true_deg, predicted_deg, ".", color=BLUE, markersize=2.5, alpha=0.35, markeredgewidth=0)
    _mark(axes, true_deg, predicted_deg, worst[:NAMED])
    axes.set(xlim=(-most_deg, most_deg), ylim=(-most_deg, most_deg), aspect="equal")
    axes.set(xlabel="recorded [°]", ylabel="predicted [°]")
    axes.text(
        0.97, 0.03, "grey line: as recorded", transform=axes.transAxes, ha="right", fontsize=7, color=GREY
    )
    bare(axes)
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    axes.axvline(0.0, color=FAINT, linewidth=0.8)


def as_image(figure: "Figure", width_px: int) -> Image:
    """``figure`` drawn, (height, ``width_px``, 3), BGR."""
    figure.set_size_inches(width_px / DPI, figure.get_figheight())
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    drawn = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGR)
    return np.asarray(cv2.resize(drawn, (width_px, drawn.shape[0])), np.uint8)
