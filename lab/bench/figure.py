"""The figure of a benchmark: a panel of bars for each column of its largest table."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lab.bench.text import Row, columns_of, grids, value_text
from trepid.images.figure_style import BLUE, bare, new_figure, save

MAX_PANELS, MAX_BARS = 4, 32
LOGARITHMIC_FROM = 400.0  # ratio of the greatest to the least value
UNITS = {  # ending of the name of a column -> its unit
    "per_s": "1/s",
    "percent": "%",
    "mps3": "m/s³",
    "mps2": "m/s²",
    "mps": "m/s",
    "degps": "°/s",
    "deg": "°",
    "hz": "Hz",
    "mb": "MB",
    "ms": "ms",
    "us": "µs",
    "km": "km",
    "m": "m",
    "s": "s",
}


def draw(measured: Mapping[str, Any], path: Path, *, values: str = "") -> None:
    """Write the figure of ``measured`` to ``path``; nothing where no table has two rows to compare.

    Columns of equal numbers are left out. ``values``: meaning and unit of the numbers, where neither the title of
    the table nor the names of its columns give them. Raises InputError when the file cannot be written.
    """
    title, rows = max(grids(measured), key=lambda table: len(table[1]), default=("", {}))
    columns = [column for column in columns_of(rows) if len(set(_numbers(rows, column).values())) > 1]
    columns = columns[:MAX_PANELS]
    names = [name for name in rows if any(name in _numbers(rows, column) for column in columns)][:MAX_BARS]
    if len(names) < 2:
        return
    figure = new_figure(3.0 + 2.2 * len(columns), 1.3 + 0.24 * len(names), layout="constrained")
    figure.suptitle("; ".join(filter(None, (title, values))), fontsize=10, x=0.01, ha="left")
    for panel, column in zip(
        figure.subplots(1, len(columns), sharey=True, squeeze=False)[0], columns, strict=True
    ):
        found = _numbers(rows, column)
        lengths = [found.get(name, math.nan) for name in names]
        bars = panel.barh(names, lengths, color=BLUE)
        panel.bar_label(bars, [value_text(found.get(name)) for name in names], padding=2, fontsize=7)
        panel.margins(x=0.25)
        least = min(found.values())
        if least > 0 and max(found.values()) > LOGARITHMIC_FROM * least:
            panel.set_xscale("log")
        panel.set_title(with_unit(column), fontsize=9)
        panel.tick_params(labelsize=8)
        bare(panel)
    figure.axes[0].invert_yaxis()
    save(figure, path)


def with_unit(column: str) -> str:
    """The name of a column in words, with the unit of its ending: ``median_ms`` is ``median [ms]``."""
    for ending, unit in UNITS.items():
        stem = column.removesuffix(f"_{ending}")
        if stem != column:
            return f"{stem.replace('_', ' ')} [{unit}]"
    return column.replace("_", " ")


def _numbers(rows: Mapping[str, Row], column: str) -> dict[str, float]:
    """The finite numbers of ``column`` by row."""
    values = {name: row.get(column) for name, row in rows.items()}
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    }
