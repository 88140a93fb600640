"""Two recordings side by side: figures of each, and the first decision that differs.

Times count from the start of each drive. Every decision of A is compared with the newest decision of B by the same
time, so that clocks of different drives do not matter.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cockpit.logbook.recall import Recall, recall
from cockpit.replay.difference import differences
from trepid.images.figure_style import BLUE, VERMILION, bare, new_figure
from trepid.types import Column

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Course = tuple[Column, Column, Column, Column]
"""Time from the start [s], fear, speed [m/s] and lateral offset [m], each of shape (n,)."""
MEANINGS = {
    "duration_s": "from the first decision to the last",
    "decisions": "number of decisions of the supervisor",
    "distance_m": "integral of the measured speed",
    "mean_speed_mps": "mean of the measured speed at the decisions",
    "max_fear": "greatest fear",
    "mean_fear": "mean fear of the decisions",
}
"""The meaning of each figure but the seconds by mode and cause."""
FIELDS = ("mode", "cause", "fear", "speed_cap_mps")
SAME_S = 1e-3  # drives whose ends are no further apart cover the same time


def figures(drive: Recall) -> dict[str, float | None]:
    """The figures of a drive by name and unit; None where no message gives the value.

    Distance: integral of the measured speed over the decisions, rectangle rule. Seconds by mode and cause: each
    decision applies until the next one.
    """
    steps_s = np.diff(drive.t_s)
    speed = drive.speed_mps
    known = bool(np.isfinite(speed).any())
    fear = np.array([decision.fear for decision in drive.decisions])
    found: dict[str, float | None] = {
        "duration_s": float(drive.t_s[-1] - drive.t_s[0]),
        "decisions": len(fear),
        "distance_m": float(np.nansum(speed[:-1] * steps_s)) if known else None,
        "mean_speed_mps": float(np.nanmean(speed)) if known else None,
        "max_fear": float(fear.max()),
        "mean_fear": float(fear.mean()),
    }
    for name in ("mode", "cause"):
        values = [str(getattr(decision, name)) for decision in drive.decisions]
        for value, step_s in zip(values, steps_s, strict=False):
            key = f"{name}_{value}_s"
            found[key] = (found.get(key) or 0.0) + float(step_s)
    return found


def compare_drives(one: Path, other: Path) -> tuple[dict[str, Any], "tuple[Recall, Recall]"]:
    """The comparison of two recordings, for JSON, and both drives. Raises InputError.

    ``spans_s``: times of the first and the last decision of each. ``common_s``: those of the decisions that were
    compared; None without any. ``equal``: nothing differs, and both cover the same time.
    """
    first, second = recall(one).without_undecodable(), recall(other).without_undecodable()
    difference, common = first_difference(first, second), first.t_s[_common(first, second)]
    spans_s = [_ends(first.t_s), _ends(second.t_s)]
    return {
        "kind": "recordings",
        "figures": side_by_side(figures(first), figures(second)),
        "equal": difference is None and bool(np.ptp(spans_s, axis=0).max() <= SAME_S),
        "spans_s": spans_s,
        "common_s": _ends(common) if len(common) else None,
        "first_difference": difference,
    }, (first, second)


def _ends(t_s: Column) -> list[float]:
    return [round(float(t_s[0]), 3), round(float(t_s[-1]), 3)]


def _common(one: Recall, other: Recall) -> Any:
    """Indices of the decisions of ``one`` in the time that both drives cover, shape (n,)."""
    first_s, last_s = max(one.t_s[0], other.t_s[0]), min(one.t_s[-1], other.t_s[-1])
    return np.flatnonzero((first_s <= one.t_s) & (one.t_s <= last_s))


def side_by_side(one: dict[str, Any], other: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for each figure of either: its name, both values and B - A; seconds of an absent state are 0."""
    rows = []
    for name in dict.fromkeys((*one, *other)):
        absent = 0.0 if name.startswith(("mode_", "cause_")) else None
        a, b = one.get(name, absent), other.get(name, absent)
        rows.append({"name": name, "a": a, "b": b, "change": None if a is None or b is None else b - a})
    return rows


def first_difference(one: Recall, other: Recall) -> dict[str, Any] | None:
    """The first time from the start at which mode, cause, fear or speed cap differ; None: nowhere in both."""
    for index in _common(one, other).tolist():
        t_s = float(one.t_s[index])
        found = differences(one.decisions[index], other.decisions[other.index_at(t_s)])
        changed = {name: [a, b] for name, a, b in found if name in FIELDS}
        if changed:
            return {"t_s": round(t_s, 3), "fields": changed}
    return None


def course(drive: Recall) -> Course:
    """What is drawn of a recording."""
    offset_m = np.array([decision.lateral_offset_m for decision in drive.decisions], dtype=np.float64)
    fear = np.array([decision.fear for decision in drive.decisions])
    return drive.t_s, fear, drive.speed_mps, offset_m


def courses(drives: tuple[Course, Course], names: tuple[str, str]) -> "Figure":
    """Fear, speed [m/s] and lateral offset [m] of both drives over time, on one axis each."""
    figure = new_figure(9, 6, layout="constrained")
    axes = figure.subplots(3, sharex=True)
    for (t_s, *values), name, colour, style in zip(
        drives, names, (BLUE, VERMILION), ("-", "--"), strict=True
    ):
        for panel, column in zip(axes, values, strict=True):
            panel.plot(t_s, column, color=colour, linestyle=style, linewidth=1.2, label=name)
    for panel, label in zip(axes, ("fear", "speed [m/s]", "lateral offset [m]"), strict=True):
        panel.set_ylabel(label)
        bare(panel)
    lines, labels = axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper center", ncols=2, frameon=False, fontsize=8)
    axes[-1].set_xlabel("time from the start of the drive [s]")
    return figure
