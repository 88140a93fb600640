"""What became of a drive: of which kind its failure is."""

from collections.abc import Mapping, Sequence
from typing import Any

Row = dict[str, Any]
DRIVEN, LEFT, STOPPED = "route driven in the lane", "lane left", "stopped or late"


def kind_of(row: Mapping[str, Any]) -> str:
    """What became of a drive: a wheel outside, else the route not driven to its end, else neither."""
    if row["departures"]:
        return LEFT
    return DRIVEN if row["driven_percent"] >= 99.0 else STOPPED


def kinds(rows: Sequence[Mapping[str, Any]]) -> Row:
    """How many drives there are of each kind, and the farthest from the centre of the lane [m]."""
    said = [kind_of(row) for row in rows]
    errors_m = [row["max_lateral_error_m"] for row in rows if row["max_lateral_error_m"] is not None]
    return {kind: said.count(kind) for kind in (DRIVEN, STOPPED, LEFT)} | {
        "farthest [m]": round(max(errors_m), 2) if errors_m else None
    }
