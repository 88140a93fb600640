"""A rule file as pictures: the sets of its inputs, and fear over two of them."""

import numpy as np

from cockpit.pictures import plot
from cockpit.pictures.plot import FIVE, GREY, INK, Axes
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import LEVELS, Input
from trepid.types import Column, Image

COLUMNS = 3
CELL_PX = (380, 196)
TAIL = 0.15  # of the sets' span, shown of a range that goes on flat
FAR = 2.0  # of the sets' span: only a longer flat stretch below them is cut
SAMPLES = 121  # of an input, for a surface
_WRAP = 58  # characters of a meaning


def sets_figure(rules: FearRules) -> Image:
    """The five sets of every input, and the levels of fear with their speed factor."""
    names = list(rules.inputs)
    rows = -(-(len(names) + 1) // COLUMNS)
    canvas = plot.blank(COLUMNS * CELL_PX[0], rows * CELL_PX[1] + 44)
    _legend(canvas, rules)
    for number, name in enumerate(names):
        _sets(canvas, _cell(number), name, rules.inputs[name])
    _speed(canvas, _cell(len(names)), rules)
    return canvas


def surface_figure(rules: FearRules, x_name: str, y_name: str, others: dict[str, float | None]) -> Image:
    """Fear over two inputs, the rest as ``others`` has it."""
    x, y, fear = surface(rules, x_name, y_name, others)
    canvas = plot.blank(720, 552)
    axes = Axes(86, 64, 580, 500, (x[0], x[-1]), (y[0], y[-1]))
    plot.shade(canvas, axes, fear)
    for at, name in zip([action.at for action in rules.file.fear.all[1:]], LEVELS[1:], strict=True):
        _contour(canvas, axes, fear, at - 1e-6)
        _name_contour(canvas, axes, x, y, fear, at - 1e-6, name)
    plot.frame(canvas, axes, x_label=_label(rules, x_name), y_label=_label(rules, y_name), grid=False)
    _scale(canvas, axes, rules)
    plot.write(canvas, f"Fear over {x_name} and {y_name}", axes.left, 28, size=17, bold=True)
    rest = f"{_risks(rules, x_name, y_name)}; {_rest(rules, x_name, y_name, others)}"
    plot.write(canvas, rest, axes.left, 48, size=12, colour=GREY)
    return canvas


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
    """The part of the range in which the sets change, and a little of what goes on flat beyond."""
    low, high = spec.range
    inner = [x for level in LEVELS for x, _ in spec.shape(level).corners() if low < x < high]
    tail = TAIL * (max(inner) - min(inner))
    far = min(inner) - low > FAR * (max(inner) - min(inner))
    return (min(inner) - tail if far else low), min(high, max(inner) + tail)


def _cell(number: int) -> tuple[float, float]:
    row, column = divmod(number, COLUMNS)
    return column * CELL_PX[0], row * CELL_PX[1] + 44


def _axes(corner: tuple[float, float], x: tuple[float, float]) -> Axes:
    left, top = corner
    return Axes(left + 40, top + 44, left + CELL_PX[0] - 22, top + CELL_PX[1] - 44, x, (0.0, 1.05))


def _sets(canvas: Image, corner: tuple[float, float], name: str, spec: Input) -> None:
    axes = _axes(corner, shown_range(spec))
    unit = "" if spec.unit == "1" else f" [{spec.unit}]"
    worse = "more is worse" if spec.risk == "rising" else "less is worse"
    plot.write(canvas, name, axes.left, corner[1] + 17, size=13, bold=True)
    plot.write(canvas, _short(spec.meaning), axes.left, corner[1] + 34, size=10, colour=GREY)
    plot.frame(canvas, axes, x_label=f"{name}{unit}, {worse}", y_label="", y_ticks=[0, 0.5, 1])
    colours = FIVE if spec.risk == "rising" else FIVE[::-1]
    x = np.linspace(*axes.x, 400)
    for level, colour in zip(LEVELS, colours, strict=True):
        shape = spec.shape(level)
        places = np.union1d(x, shape[:4]).clip(max(shape.a, axes.x[0]), min(shape.d, axes.x[1]))
        degrees = np.array([shape.membership(float(u)) for u in places])
        plot.line(canvas, axes.at(places, degrees), colour, width=1.6)


def _speed(canvas: Image, corner: tuple[float, float], rules: FearRules) -> None:
    """What fear does."""
    axes = _axes(corner, (0.0, 1.0))
    plot.write(canvas, "what fear does", axes.left, corner[1] + 17, size=13, bold=True)
    plot.write(
        canvas,
        "share of the cruise speed, and the mode of each level",
        axes.left,
        corner[1] + 34,
        size=10,
        colour=GREY,
    )
    plot.frame(canvas, axes, x_label="fear", y_label="", y_ticks=[0, 0.5, 1])
    fear = np.linspace(0.0, 1.0, 201)
    factors = np.array([rules.speed_factor(float(f)) for f in fear])
    plot.line(canvas, axes.at(fear, factors), INK, width=1.6)
    for action, colour in zip(rules.file.fear.all, FIVE, strict=True):
        ((x, y),) = axes.at(action.at, action.speed_factor)
        plot.line(canvas, np.array([[x, axes.bottom], [x, y]]), colour, width=1.6)
        right = 1.0 - action.at < 0.1
        at, anchor = (x - 2, "right") if right else (x + 4, "left")
        plot.write(canvas, action.mode.value, at, axes.bottom - 6, size=9, anchor=anchor)


def _legend(canvas: Image, rules: FearRules) -> None:
    plot.write(canvas, "Sets of the inputs", 40, 26, size=17, bold=True)
    x = 230.0
    plot.write(canvas, "from calm to feared:", x, 26, size=12, colour=GREY)
    x += plot.text_width("from calm to feared:", size=12) + 14
    for number, colour in enumerate(FIVE, start=1):
        plot.line(canvas, np.array([[x, 22], [x + 26, 22]]), colour, width=2.0)
        plot.write(canvas, str(number), x + 31, 26, size=12)
        x += 54
    text = "1 is very_low and 5 very_high where more is worse, the other way round where less is"
    plot.write(canvas, text, x + 4, 26, size=12, colour=GREY)


def _contour(canvas: Image, axes: Axes, fear: Column, at: float) -> None:
    """The lines on which fear is ``at``: edges between samples on either side, by marching squares."""
    rows, columns = fear.shape
    for i in range(rows - 1):
        for j in range(columns - 1):
            crossings = _crossings(fear[i : i + 2, j : j + 2], at)
            if len(crossings) >= 2:
                places = np.array([(j + u, i + v) for u, v in crossings[:2]])
                x = axes.left + places[:, 0] / (columns - 1) * (axes.right - axes.left)
                y = axes.bottom - places[:, 1] / (rows - 1) * (axes.bottom - axes.top)
                plot.line(canvas, np.stack([x, y], axis=-1), plot.PAPER, width=0.8)


def _crossings(square: Column, at: float) -> list[tuple[float, float]]:
    """Where the edges of a square of samples pass ``at``, as (right, up) in 0..1."""
    (a, b), (c, d) = square.tolist()
    found = []
    for low, high, place in (
        (a, b, lambda s: (s, 0.0)),
        (b, d, lambda s: (1.0, s)),
        (c, d, lambda s: (s, 1.0)),
        (a, c, lambda s: (0.0, s)),
    ):
        if (low < at) != (high < at):
            found.append(place((at - low) / (high - low)))
    return found


def _name_contour(
    canvas: Image, axes: Axes, x: Column, y: Column, fear: Column, at: float, name: str
) -> None:
    """The level's name where its region is, off the edges."""
    inside = np.argwhere((fear >= at) & (fear < at + 0.2))
    if len(inside) == 0:
        return
    row, column = inside[len(inside) // 2]
    ((px, py),) = axes.at(x[column], y[row])
    px = float(np.clip(px, axes.left + 34, axes.right - 34))
    py = float(np.clip(py, axes.top + 16, axes.bottom - 8))
    ink = plot.PAPER if fear[row, column] < 0.6 else INK
    plot.write(canvas, name, px, py, size=11, colour=ink, anchor="centre")


def _scale(canvas: Image, axes: Axes, rules: FearRules) -> None:
    """The colours of fear, with its levels."""
    bar = Axes(axes.right + 30, axes.top, axes.right + 46, axes.bottom, (0.0, 1.0), (0.0, 1.0))
    plot.shade(canvas, bar, np.linspace(0, 1, 256)[:, None].repeat(2, axis=1))
    plot.write(canvas, "fear", bar.left, bar.top - 8, size=12)
    for action, level in zip(rules.file.fear.all, LEVELS, strict=True):
        ((_, y),) = bar.at(0.0, action.at)
        plot.write(canvas, f"{action.at:g}", bar.right + 6, y + 4, size=11, colour=GREY)
        plot.write(canvas, level, bar.right + 34, y + 4, size=11)


def _label(rules: FearRules, name: str) -> str:
    unit = rules.inputs[name].unit
    return name if unit == "1" else f"{name} [{unit}]"


def _rest(rules: FearRules, x_name: str, y_name: str, others: dict[str, float | None]) -> str:
    given = {
        name: value
        for name, value in others.items()
        if name not in (x_name, y_name) and value != rules.inputs[name].calmest
    }
    told = [f"{name} = {'missing' if value is None else f'{value:g}'}" for name, value in given.items()]
    return ", ".join([*told, "the other inputs calm" if told else "all other inputs calm"])


def _risks(rules: FearRules, *names: str) -> str:
    ways = {"rising": "more", "falling": "less"}
    return "; ".join(f"{ways[rules.inputs[name].risk]} {name} is worse" for name in names)


def _short(text: str) -> str:
    return text if len(text) <= _WRAP else text[: _WRAP - 1].rsplit(" ", 1)[0] + " …"
