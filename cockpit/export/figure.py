"""A drive as a figure: fear, speed, lateral error and curvature over time."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from cockpit.export.table import Table
from trepid.images.figure_style import (
    FEAR_COLOURS,
    GREY,
    INK,
    PATH,
    bare,
    estimator_colours,
    new_figure,
    save,
)

SIZE_IN = (10.0, 8.0)


def write_figure(rows: Table, estimators: list[str], out: Path, title: str) -> None:
    """Write the figure; the suffix of ``out`` is its format. Raises InputError."""
    t_s = np.array(rows["t_s"], dtype=np.float64)
    figure = new_figure(*SIZE_IN, layout="constrained")
    fear, speed, error, curvature = figure.subplots(4, sharex=True)
    figure.suptitle(title, color=INK)

    def line(axes: Any, name: str, text: str, colour: str, **style: Any) -> None:
        values = np.array([math.nan if value is None else value for value in rows[name]], dtype=np.float64)
        axes.plot(t_s, values, color=colour, label=text, **style)

    line(fear, "fear", "fear", FEAR_COLOURS[-1])
    fear.set(ylabel="fear", ylim=(-0.03, 1.03))
    line(speed, "speed_cap_mps", "speed cap", GREY, linestyle="--")
    line(speed, "speed_mps", "speed", INK)
    speed.set(ylabel="speed [m/s]")
    for axes, name in ((error, "lateral_offset_m"), (curvature, "curvature_1pm")):
        for one, colour in estimator_colours(estimators).items():
            line(axes, f"{one}_{name}", one, colour, linewidth=1)
        line(axes, f"path_{name}", "fused path", PATH)
    error.set(ylabel="offset from the lane\ncentre [m], + left")
    curvature.set(ylabel="curvature [1/m],\n+ left", xlabel="time since the start of the drive [s]")
    for axes in (fear, speed, error, curvature):
        bare(axes)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    save(figure, out)
