"""Figures by matplotlib: size, colours and files; and what a colour means, in figures, reports and on the page.

Bluish green over amber to red is fear, and the modes that it causes; purple is the vehicle ahead, and the mode that
follows it; cyan is the path; blue and pink are estimates of lines and of the network. Other colours are those of
Okabe and Ito, Color Universal Design (2008), and the perceptually even map ``viridis``, both safe for colour-blind
readers; neighbours of ``FEAR_COLOURS`` differ in brightness too. matplotlib is imported when a figure is drawn,
because it takes 0.3 s to load.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trepid.config import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, GREY, FAINT = "#26282d", "#767879", "#dededf"
BLUE, SKY, GREEN, ORANGE, VERMILION = "#0072b2", "#56b4e9", "#009e73", "#e69f00", "#d55e00"
FEAR_COLOURS = ("#00795a", "#56ad8a", "#f0c000", "#e07b00", "#b3261e")
"""From the least to the greatest risk."""
PATH, LEAD = "#007a94", "#7a2f9f"
ESTIMATORS = {"cv": BLUE, "cnn": "#b0246e"}
OTHER_ESTIMATORS = (SKY, GREY, "#5c4fa3", INK)
MAP = "viridis"
DPI = 130


def estimator_colours(names: Sequence[str]) -> dict[str, str]:
    """A colour of each estimator: its own for ``cv`` and ``cnn``, for others one of those that nothing else has."""
    others = [name for name in names if name not in ESTIMATORS]
    more = {name: OTHER_ESTIMATORS[number % len(OTHER_ESTIMATORS)] for number, name in enumerate(others)}
    return {name: ESTIMATORS.get(name) or more[name] for name in names}


def new_figure(width_in: float, height_in: float, **layout: Any) -> "Figure":
    """An empty figure without a window (Agg), in one style."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: Any = {
        "font.size": 9,
        "axes.edgecolor": GREY,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": GREY,
        "ytick.color": GREY,
    }
    matplotlib.rcParams.update(style)
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white", **layout)
    FigureCanvasAgg(figure)
    return figure


def bare(axes: Any) -> None:
    """Show only the left and the lower line of ``axes``, and a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def save(figure: "Figure", path: Path) -> None:
    """Write a figure to ``path``; the suffix is the format. Raises InputError where that fails."""
    known = figure.canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".").lower() not in known:
        raise InputError(f"{path}: unknown format of a picture; known: .{', .'.join(sorted(known))}")
    try:
        figure.savefig(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
