"""The aims of learning from drives, and whether they are met."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

Row = Mapping[str, Any]
FARTHEST, AUTONOMY = "alone, farthest beside the centre [m]", "alone, autonomy [%]"  # tables of drives
DEPARTURES, DRIVEN = "supervised beside cv and cnn, departures", "supervised beside cv and cnn, driven [%]"
KINDS = "what became of the drives"
SHIFTED = "coverage of the 90 % intervals on changed images of the unseen roads"
MOVED = "mean change of the steering wheel by the changed image [°]"
UNLIKE = "share of the changed images that the network finds unlike its training"
EXACT = "exact angles instead of a network, {} mph"  # bends that these leave are too tight for the limiter

MOST_TO_PEER = 0.8  # of the error of donkeycar's network
LEAST_R2, LEAST_R2_SIMULATED = 0.0, 0.6
SIMULATED = ("donkey_sim_carpet", "udacity_sim_track")
COVERAGE, COVERAGE_OFF = 0.9, 0.015
LEAST_COVERAGE = 0.85  # on other roads
MOST_DEG, MOST_SHARP_DEG, LEAST_R2_HARNESS = (
    1.5,
    3.0,
    0.99,
)  # of the steering wheel, on unseen roads of the simulator
MOST_WEIGHTS, MOST_MS = 300_000, 1.0
MOST_BESIDE_M, OPEN_ROADS = 0.3, ("driveways", "intersection")  # alone, past roads that branch off
FRAME, SEQUENCE = "steer", "steer-lstm"
MOST_RATE = 0.5  # rms of the steering rate of the sequence, relative to the frame
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
        f"at_most_{MOST_TO_PEER}": _met_or_missed(row["mae_deg"] <= MOST_TO_PEER * peer["mae_deg"]),
        "error_to_blind": row["mae_deg"] / blind,
        "below_1": _met_or_missed(row["mae_deg"] < blind),
        "r2": r2,
        "least_r2": least,
        "r2_enough": _met_or_missed(r2 is not None and (r2 >= least if simulated else r2 > least)),
        "coverage_90": coverage,
        f"within_{COVERAGE_OFF}": _met_or_missed(abs(coverage - COVERAGE) <= COVERAGE_OFF),
    }


def judge_simulation(tables: Mapping[str, Mapping[str, Row]]) -> dict[str, dict[str, Any]]:
    """Aim -> measured value, the aim and whether it is met.

    Of the network with the least error on the random roads, and of the one that drives.
    """
    networks = {name: row for name, row in tables["unseen roads"].items() if "weights" in row}
    chosen = min(
        networks, key=lambda name: networks[name]["mae_random_deg"]
    )  # on other roads than it is judged
    best = networks[chosen]
    autonomy = [share for row in tables[AUTONOMY].values() for share in row.values()]
    beside_m = [tables[FARTHEST][name].values() for name in OPEN_ROADS if name in tables[FARTHEST]]
    farthest_m = max(chain.from_iterable(beside_m), default=None)
    sharp_deg, r2 = best["mae_beyond_40_deg"], best["r2"]
    departures = sum(chain.from_iterable(row.values() for row in tables[DEPARTURES].values()))
    shift = min(tables[SHIFTED], key=lambda one: tables[SHIFTED][one][chosen])
    covered = tables[SHIFTED][shift][chosen]
    frame, sequence = networks[FRAME], networks[SEQUENCE]
    slower = sequence["rate_rms_degps"] / frame["rate_rms_degps"]
    aims: dict[str, tuple[Any, str, bool]] = {
        f"mae_deg of {chosen}": (best["mae_deg"], f"at most {MOST_DEG}", best["mae_deg"] <= MOST_DEG),
        f"mae_beyond_40_deg of {chosen}": (
            sharp_deg,
            f"at most {MOST_SHARP_DEG}",
            sharp_deg is not None and sharp_deg <= MOST_SHARP_DEG,
        ),
        f"r2 of {chosen}": (r2, f"at least {LEAST_R2_HARNESS}", r2 is not None and r2 >= LEAST_R2_HARNESS),
        f"weights of {chosen}": (best["weights"], f"at most {MOST_WEIGHTS}", best["weights"] <= MOST_WEIGHTS),
        f"latency_ms of {chosen}": (best["latency_ms"], f"at most {MOST_MS}", best["latency_ms"] <= MOST_MS),
        f"steering rate, {SEQUENCE} to {FRAME}": (
            slower,
            f"at most {MOST_RATE}, at no greater mae_deg",
            slower <= MOST_RATE and sequence["mae_deg"] <= frame["mae_deg"],
        ),
        f"coverage_90_random of {chosen}": (
            best["coverage_90_random"],
            f"{COVERAGE} ± {COVERAGE_OFF}",
            abs(best["coverage_90_random"] - COVERAGE) <= COVERAGE_OFF,
        ),
        f"coverage_90 of {chosen} on unseen roads": (
            best["coverage_90"],
            f"at least {LEAST_COVERAGE}",
            best["coverage_90"] >= LEAST_COVERAGE,
        ),
        f"coverage_90 of {chosen} under its worst shift, {shift}": (
            covered,
            f"at least {LEAST_COVERAGE}",
            covered >= LEAST_COVERAGE,
        ),
        "least autonomy alone [%]": (min(autonomy), "100", min(autonomy) >= 100.0),
        "farthest at branches [m]": (
            farthest_m,
            f"at most {MOST_BESIDE_M}",
            farthest_m is not None and farthest_m <= MOST_BESIDE_M,
        ),
        "departures supervised": (departures, "0", departures == 0),
    }
    return {
        name: {"measured": value, "aim": aim, "is": _met_or_missed(met)}
        for name, (value, aim, met) in aims.items()
    }


def _met_or_missed(reached: bool) -> str:
    return "met" if reached else "missed"
