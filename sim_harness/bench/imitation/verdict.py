"""The aims of learning from real drives, and whether they are met."""

from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]

MOST_TO_PEER = 0.8  # of the error of donkeycar's network
LEAST_R2, LEAST_R2_SIMULATED = 0.0, 0.6
SIMULATED = ("donkey_sim_carpet", "udacity_sim_track")
COVERAGE, COVERAGE_OFF = 0.9, 0.015
WITHOUT_IMAGE = ("always_straight", "mean")  # the angle of 0.2 s ago is the driver's own


def verdicts(
    table: Mapping[str, Mapping[str, Row]], ours: Sequence[str], peer: str
) -> dict[str, dict[str, Any]]:
    """Set and network -> errors relative to ``peer`` and to the best baseline without image, R², coverage."""
    return {
        f"{name}, {network}": _verdict(rows[network], rows[peer], rows, simulated=name in SIMULATED)
        for name, rows in table.items()
        for network in ours
    }


def _verdict(row: Row, peer: Row, rows: Mapping[str, Row], *, simulated: bool) -> dict[str, Any]:
    blind = min(rows[name]["mae_deg"] for name in WITHOUT_IMAGE)
    least = LEAST_R2_SIMULATED if simulated else LEAST_R2
    r2, coverage = row["r2"], row["coverage_90"]
    return {
        "error_to_peer": row["mae_deg"] / peer["mae_deg"],
        f"at_most_{MOST_TO_PEER}": _met(row["mae_deg"] <= MOST_TO_PEER * peer["mae_deg"]),
        "error_to_blind": row["mae_deg"] / blind,
        "below_1": _met(row["mae_deg"] < blind),
        "r2": r2,
        "least_r2": least,
        "r2_enough": _met(r2 is not None and (r2 >= least if simulated else r2 > least)),
        "coverage_90": coverage,
        f"within_{COVERAGE_OFF}": _met(abs(coverage - COVERAGE) <= COVERAGE_OFF),
    }


def _met(reached: bool) -> str:
    return "met" if reached else "missed"
