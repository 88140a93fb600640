"""The optimisers of the training loop on the network of Rausch et al., at equal epochs (O01, O02, N08).

The review names stochastic gradient descent by back-propagation with its drawbacks, Nesterov's gradient, RMSprop
and Adam, and cites the errors of one network with three of them: 0.0338 by Nesterov's, 0.0395 by gradient
descent, 0.0465 by Adam, with batches of 128. Here the same network learns other frames
(:mod:`lab.bench.study.passages`), half of them mirrored, in batches of 16: 128 would leave too few steps. Every
optimiser has the best of RATES_BELOW_AND_ABOVE around its usual rate, chosen by the validation error of a short
training with a seed of its own; then SEEDS trainings. One line a training in ``runs/optimisers_<seed>.jsonl``:
an interrupted benchmark continues.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from lab.bench.study.passages import (
    Passages,
    errors_deg,
    every_nth,
    mean_row,
    passages,
    resize,
    stages,
    straight_deg,
    train_passages,
)
from learning.rendered import need_torch
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from trepid.config import WORK_DIR

Row = dict[str, Any]
MODEL = "rausch"
EPOCHS, SHORT_EPOCHS = 16, 6
SEEDS = 4
EVERY = 4  # frame of the training
HEIGHT_PX, WIDTH_PX = 24, 48
RATES_BELOW_AND_ABOVE = (0.3, 1.0, 3.0)
OPTIMISERS: Mapping[str, tuple[Mapping[str, str], float]] = MappingProxyType(
    {
        "gradient descent": ({"optimiser": "sgd", "momentum": "0"}, 1e-1),
        "momentum": ({"optimiser": "sgd", "momentum": "0.9"}, 1e-2),
        "Nesterov": ({"optimiser": "nag", "momentum": "0.9"}, 1e-2),
        "Adagrad": ({"optimiser": "adagrad"}, 1e-2),
        "Adadelta": ({"optimiser": "adadelta"}, 1.0),
        "RMSprop": ({"optimiser": "rmsprop"}, 1e-3),
        "Adam": ({"optimiser": "adam"}, 1e-3),
        "Nadam": ({"optimiser": "nadam"}, 1e-3),
        "AdamW": ({"optimiser": "adamw"}, 1e-3),
    }
)
"""Row -> changes of the recipe, usual learning rate."""
PAPER = MappingProxyType({"Nesterov": 0.0338, "gradient descent": 0.0395, "Adam": 0.0465})
FIXED = MappingProxyType({"batch": "16", "weight_decay": "0", "average": "0", "augmentation.flip": "0.5"})


class OptimiserTraining(NamedTuple):
    """A training of the table."""

    data_seed: int
    optimiser: str
    rate: float
    epochs: int
    seed: int


def train_one(one: OptimiserTraining) -> Row:
    """The errors of a training; a loss that leaves the finite numbers has none."""
    from learning.training.loop import Divergence

    frames = frames_of(one.data_seed)
    changes = {**FIXED, **OPTIMISERS[one.optimiser][0], **stages(one.epochs, one.rate), "seed": str(one.seed)}
    try:
        network, progress = train_passages(frames, MODEL, changes)
    except Divergence:
        return {"validation_deg": None}
    found = errors_deg(network, frames.test)
    curve = [float(np.degrees(point["validation_mae_rad"])) for point in progress.curve]
    return {
        "validation_deg": min(curve),
        "curve_deg": curve,
        "mae_deg": float(np.abs(found).mean()),
        "rmse_deg": float(np.sqrt((found**2).mean())),
        "std_deg": float(found.std()),
        "seconds": progress.elapsed_s,
    }


def frames_of(seed: int) -> Passages:
    """The frames of the study: small ones, and fewer to learn from."""
    train, validation, test = (resize(one, HEIGHT_PX, WIDTH_PX) for one in passages(seed))
    return Passages(every_nth(train, EVERY), every_nth(validation, EVERY), test)


def bench_optimisers(seed: int) -> Row:
    """The errors of the optimisers over the seeds, and the epochs that each needs for the error of the worst."""
    need_torch("bench study optimisers")
    frames = frames_of(seed)
    short = {
        f"{name} {factor * rate:g}": OptimiserTraining(seed, name, factor * rate, SHORT_EPOCHS, seed + 1000)
        for name, (_, rate) in OPTIMISERS.items()
        for factor in RATES_BELOW_AND_ABOVE
    }
    tried = dict(zip(short.values(), _rows_of(seed, short), strict=True))
    rates = {
        name: best_rate({one: row for one, row in tried.items() if one.optimiser == name})
        for name in OPTIMISERS
    }
    whole = {
        f"{name} {rates[name]:g} seed {number}": OptimiserTraining(
            seed, name, rates[name], EPOCHS, seed + number
        )
        for number in range(SEEDS)
        for name in OPTIMISERS
    }
    rows = _rows_of(seed, whole)
    found = {
        name: [row for one, row in zip(whole.values(), rows, strict=True) if one.optimiser == name]
        for name in OPTIMISERS
    }
    return compare(found, rates) | {
        "always straight [deg]": round(straight_deg(frames.test), 3),
        "frames": len(frames.train),
        "epochs": EPOCHS,
        "seeds": SEEDS,
    }


def best_rate(tried: Mapping[OptimiserTraining, Row]) -> float:
    """The learning rate with the least validation error."""
    finite = {one: row["validation_deg"] for one, row in tried.items() if row["validation_deg"] is not None}
    return min(finite, key=lambda one: finite[one]).rate


def compare(found: Mapping[str, list[Row]], rates: Mapping[str, float]) -> Row:
    """The table: means over the seeds, the best first; without a row where a training had no finite loss."""
    whole = {name: rows for name, rows in found.items() if all("mae_deg" in row for row in rows)}
    slowest = max(np.mean([row["validation_deg"] for row in rows]) for rows in whole.values())
    table = {}
    for name, rows in whole.items():
        plain = [{key: value for key, value in row.items() if key != "curve_deg"} for row in rows]
        needed = [
            next(
                epoch
                for epoch, error in enumerate(row["curve_deg"], start=1)
                if error <= max(slowest, min(row["curve_deg"]))
            )
            for row in rows
        ]
        table[name] = mean_row(plain) | {
            "spread of the seeds": round(float(np.std([row["mae_deg"] for row in rows])), 3),
            "epochs to the error of the worst": round(float(np.mean(needed)), 1),
            "learning rate": rates[name],
            "error in the paper": PAPER.get(name),
        }
    missing = [name for name in found if name not in whole]
    best_first = dict(sorted(table.items(), key=lambda one: one[1]["mae_deg"]))
    return {"optimisers": best_first} | ({"without a finite loss": ", ".join(missing)} if missing else {})


def _rows_of(seed: int, tasks: dict[str, OptimiserTraining]) -> list[Row]:
    code = fingerprint(
        *import_closure([__name__, "learning.training.run", "learning.models.papers"]), "config"
    )
    codes = {name: short_hash(code, *map(str, one)) for name, one in tasks.items()}
    return stored_rows(WORK_DIR / "runs" / f"optimisers_{seed}.jsonl", train_one, tasks, codes=codes, jobs=1)
