"""Clean-up by rule: frames of a drive that are left out of all splits (``--leave-out``)."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import NONE, Rows
from learning.dataset.likeness import STILL
from learning.dataset.motion import suspicious
from learning.dataset.wheel import SLOWEST_MPS
from trepid.types import Mask

DARK, BRIGHT = 0.2, 0.8  # mean grey
FROZEN_S = 0.5  # still images at least this long are a frozen piece


def frozen_pieces(rows: Rows) -> list[dict[str, Any]]:
    """Pieces of at least FROZEN_S without change in the image, the longest first."""
    return [piece for piece in pieces(rows, rows["change"] <= STILL) if piece["duration_s"] >= FROZEN_S]


def frozen_rows(rows: Rows) -> Mask:
    """The rows (n,) of :func:`frozen_pieces`."""
    found = np.zeros(len(rows), bool)
    for piece in frozen_pieces(rows):
        found[piece["row"] : piece["row"] + piece["frames"]] = True
    return found


def pieces(rows: Rows, marked: Mask) -> list[dict[str, Any]]:
    """Runs of marked rows inside a stretch, the longest first."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    found = []
    for first, end in ends.reshape(-1, 2).tolist():
        cuts = [first, *(first + 1 + np.flatnonzero(np.diff(rows["stretch"][first:end]))).tolist(), end]
        for begin, after in pairwise(cuts):
            piece = {
                "row": begin,
                "route": str(rows["route"][begin]),
                "frame": int(rows["frame"][begin]),
                "frames": after - begin,
                "image": str(rows["image"][begin]),
                "duration_s": float(rows["t_s"][after - 1] - rows["t_s"][begin]),
            }
            found.append(piece)
    return sorted(found, key=lambda piece: -int(piece["frames"]))


RULES: Mapping[str, Callable[[Rows], Mask]] = MappingProxyType(
    {
        "frozen": frozen_rows,
        "suspicious": suspicious,
        "dark": lambda rows: rows["light"] < DARK,
        "bright": lambda rows: rows["light"] > BRIGHT,
        "standing": lambda rows: rows["speed_mps"] < SLOWEST_MPS,
    }
)
"""Name of a rule -> the rows (n,) that it leaves out; an unknown light or speed leaves out none."""


def clean(rows: Rows, rules: Sequence[str]) -> NDArray[np.str_]:
    """The column ``why`` of ``rows`` after ``rules``, in their order; the first reason of a row stays.

    Labels that contradict the motion are sought among those that are left.
    """
    rows = rows.copy()
    why = rows["why"].astype("<U64")
    for name in rules:
        out = RULES[name](rows) & (why == "")
        why[out] = f"rule {name}"
        rows["split"][out] = NONE
    return why
