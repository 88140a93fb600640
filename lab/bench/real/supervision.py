"""What the supervisor makes of a sequence: fear, its causes, and the share of the time in which the car is engaged.

The footage passes as others drove it. A driver drives the first :data:`RUN_UP_S` of each drive and then lets go, so
that only frames after it tell whether the supervisor would drive; a still, or a shorter drive, has none.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_harness.footage.resimulation import RUN_UP_S
from trepid.causes import Cause
from trepid.messages import Mode

Row = dict[str, Any]
CAUSES = 4  # that are named, the most frequent first


def supervision_figures(rows: Sequence[Row]) -> dict[str, float | str | None]:
    """Mean fear of all frames, shares of the frames by the cause of their fear, share engaged after the run-up."""
    free = [row for part in _drives(rows) for row in part if row["t_s"] - part[0]["t_s"] >= RUN_UP_S]
    engaged = [row["mode"] != Mode.STOP for row in free]
    return {
        "mean_fear": float(np.mean([row["fear"] for row in rows])),
        "fear_causes": cause_shares([row["cause"] for row in rows]),
        "engaged": float(np.mean(engaged)) if engaged else None,
    }


def cause_shares(causes: Sequence[str]) -> str:
    """The most frequent causes of fear with the share of the frames of each, as text; "" without any."""
    counts = Counter(cause for cause in causes if cause != Cause.NONE)
    return ", ".join(f"{name} {count / len(causes):.2f}" for name, count in counts.most_common(CAUSES))


def _drives(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of each drive."""
    parts: dict[str, list[Row]] = {}
    for row in rows:
        parts.setdefault(row["drive"], []).append(row)
    return list(parts.values())
