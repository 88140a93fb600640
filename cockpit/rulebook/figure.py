"""A rule file as figures: the sets of its inputs, and fear over two inputs."""

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import LEVELS, Input
from trepid.images.figure_style import FEAR_COLOURS, GREY, INK, MAP, bare, new_figure
from trepid.types import Column

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 3
CELL_IN = (4.6, 2.15)
HEAD_IN = 0.7
TAIL = 0.15  # of the span of the sets: length shown of a range that continues flat
FAR = 2.0  # of the span of the sets: only a longer flat stretch below them is cut
SAMPLES = 121  # of an input, for a surface
_WRAP = 66  # characters of a line of text over a cell


def sets_figure(rules: FearRules) -> "Figure":
    """The five sets of every input by scikit-fuzzy's functions, and the speed factor over fear."""
    names = list(rules.inputs)
    rows = -(-(len(names) + 1) // COLUMNS)
    width, height = COLUMNS * CELL_IN[0], rows * CELL_IN[1] + HEAD_IN
    figure = new_figure(width, height)
    edges = dict(left=0.04, right=0.985, bottom=0.45 / height, top=1 - (HEAD_IN + 0.45) / height)
    grid = figure.add_gridspec(rows, COLUMNS, hspace=1.15, wspace=0.16, **edges)
    cells = [
        figure.add_subplot(grid[number // COLUMNS, number % COLUMNS]) for number in range(len(names) + 1)
    ]
    for axes, name in zip(cells, names, strict=False):
        _draw_sets(axes, name, rules.inputs[name])
    _draw_speed(cells[-1], rules)
    _legend(figure)
    return figure


def surface_figure(rules: FearRules, x_name: str, y_name: str, others: dict[str, float | None]) -> "Figure":
    """Fear over two inputs; the other inputs have the values ``others``."""
    x, y, fear = surface(rules, x_name, y_name, others)
    figure = new_figure(8.4, 6.4, layout="constrained")
    axes = figure.add_subplot()
    mesh = axes.pcolormesh(x, y, fear, cmap=MAP, vmin=0, vmax=1, shading="gouraud")
    at = [action.at for action in rules.file.fear.all]
    if fear.min() < fear.max():
        axes.contour(x, y, fear, levels=[place - 1e-6 for place in at[1:]], colors="white", linewidths=0.9)
    axes.set_xlabel(_label(x_name, rules.inputs[x_name]))
    axes.set_ylabel(_label(y_name, rules.inputs[y_name]))
    bar = figure.colorbar(mesh, ax=axes, ticks=at, label="fear; the white lines are the levels")
    bar.ax.set_yticklabels([f"{place:g}  {level}" for place, level in zip(at, LEVELS, strict=True)])
    figure.suptitle(f"Fear over {x_name} and {y_name}", fontsize=13, fontweight="bold")
    rest = f"{_risks(rules, x_name, y_name)}; {_rest(rules, x_name, y_name, others)}"
    axes.set_title("\n".join(textwrap.wrap(rest, 100)), fontsize=9, color=GREY)
    return figure


def surface(
    rules: FearRules,
    x_name: str,
    y_name: str,
    others: dict[str, float | None],
    samples: tuple[int, int] = (SAMPLES, SAMPLES),
) -> tuple[Column, Column, Column]:
    """The two inputs, shapes (n,) and (m,), and fear over them, shape (m, n): row for y, column for x."""
    x, y = (
        np.linspace(*shown_range(rules.inputs[name]), count)
        for name, count in zip((x_name, y_name), samples, strict=True)
    )
    fear = [[rules.evaluate({**others, x_name: u, y_name: v}).fear for u in x.tolist()] for v in y.tolist()]
    return x, y, np.array(fear)


def shown_range(spec: Input) -> tuple[float, float]:
    """The part of the range in which the sets change, and a little of the flat part beyond."""
    low, high = spec.range
    inner = [x for shape in spec.shapes.values() for x, _ in shape.corners() if low < x < high]
    tail = TAIL * (max(inner) - min(inner))
    far = min(inner) - low > FAR * (max(inner) - min(inner))
    return (min(inner) - tail if far else low), min(high, max(inner) + tail)


def risk(spec: Input) -> str:
    """The direction of the risk of an input, as text."""
    return "more is worse" if spec.risk == "rising" else "less is worse"


def _draw_sets(axes: Any, name: str, spec: Input) -> None:
    from supervisor.rules.scikit import stated_degrees  # imports scikit-fuzzy, 0.5 s

    low, high = shown_range(spec)
    colours = FEAR_COLOURS if spec.risk == "rising" else FEAR_COLOURS[::-1]
    for level, colour in zip(LEVELS, colours, strict=True):
        corners = [x for x, _ in spec.shapes[level].corners() if low < x < high]
        x = np.union1d(np.linspace(low, high, 400), corners)
        degrees = stated_degrees(spec, level, x)
        visible = np.convolve(degrees > spec.tolerance / 2, [1, 1, 1], mode="same") > 0  # with the feet
        axes.plot(x[visible], degrees[visible], color=colour, linewidth=1.6)
    _cell(axes, name, spec.meaning, f"{_label(name, spec)}, {risk(spec)}", (low, high))


def _draw_speed(axes: Any, rules: FearRules) -> None:
    """Speed factor and mode over fear."""
    fear = np.linspace(0.0, 1.0, 201)
    axes.plot(fear, [rules.speed_factor(float(f)) for f in fear], color=INK, linewidth=1.6)
    for action, colour in zip(rules.file.fear.all, FEAR_COLOURS, strict=True):
        axes.plot([action.at] * 2, [0, action.speed_factor], color=colour, linewidth=1.6)
        side = "right" if action.at > 0.9 else "left"
        offset = -3 if side == "right" else 3
        axes.annotate(
            action.mode.value, (action.at, 0.04), (offset, 0), textcoords="offset points", ha=side, fontsize=7
        )
    _cell(axes, "action", "share of the cruise speed, and the mode of each level", "fear", (0.0, 1.0))


def _cell(axes: Any, title: str, text: str, x_label: str, x_range: tuple[float, float]) -> None:
    bare(axes)
    axes.set(xlim=x_range, ylim=(0.0, 1.05), yticks=[0, 0.5, 1], xlabel=x_label)
    lines = textwrap.wrap(text, _WRAP)[:2]
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold", pad=6 + 11 * len(lines))
    axes.annotate(
        "\n".join(lines),
        (0, 1),
        (0, 5),
        xycoords="axes fraction",
        textcoords="offset points",
        color=GREY,
        fontsize=8,
    )


def _legend(figure: "Figure") -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, linewidth=2.5) for colour in FEAR_COLOURS]
    labels = [f"risk {number}" for number in range(1, len(FEAR_COLOURS) + 1)]
    figure.legend(
        handles, labels, loc="upper right", ncols=len(FEAR_COLOURS), frameon=False, bbox_to_anchor=(0.99, 1.0)
    )
    height_in = figure.get_size_inches()[1]
    figure.text(0.02, 1 - 0.25 / height_in, "Sets of the inputs", fontsize=14, fontweight="bold")
    note = (
        "risk 1 is very_low and risk 5 very_high where more is worse; the other way round where less is worse"
    )
    figure.text(0.02, 1 - 0.45 / height_in, note, color=GREY)


def _label(name: str, spec: Input) -> str:
    return name if spec.unit == "1" else f"{name} [{spec.unit}]"


def _rest(rules: FearRules, x_name: str, y_name: str, others: dict[str, float | None]) -> str:
    given = {
        name: value
        for name, value in others.items()
        if name not in (x_name, y_name) and value != rules.inputs[name].calmest
    }
    stated = [f"{name} = {'missing' if value is None else f'{value:g}'}" for name, value in given.items()]
    return ", ".join([*stated, "the other inputs calm" if stated else "all other inputs calm"])


def _risks(rules: FearRules, *names: str) -> str:
    directions = {"rising": "more", "falling": "less"}
    return "; ".join(f"{directions[rules.inputs[name].risk]} {name} is worse" for name in names)
