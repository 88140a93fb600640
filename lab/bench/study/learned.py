"""Networks trained alike but for one thing, on simulated drives at 5 mph, judged on roads of no training set.

The drives are those of :mod:`lab.bench.imitation.demonstrations` on ROADS random roads; its shipped
roads are the test. Drives, data sets, networks and rows are kept in ``out/study``, each under a hash of the code
and of all else that it depends on; an interrupted study continues. Degrees are of a steering wheel with the ratio
16, as in the paper.
"""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from lab.bench.imitation.demonstrations import demonstrations
from lab.bench.imitation.training_code import code_of_training, one_stage, train_once
from learning.dataset.dataset import Dataset
from learning.judging.evaluate import BIN_RATIO, Bench
from learning.judging.predictions import JudgedModel
from learning.rendered import need_torch
from learning.training.recipe import Recipe, load_recipe
from perception.net.driver import DriverNetwork
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from trepid.config import WORK_DIR

Row = dict[str, Any]
ROADS = 150
JUDGING = (__name__, "learning.judging.evaluate")
"""The modules that judge; their code, and what they import, is in the keys of the rows."""
EPOCHS = 8
RATE = 1.0e-3  # of learning
TRAININGS = 3
MOVED_SHARES = (0.1, 1.0)
SHARES = (0.01, 0.03, 0.1, 0.3, 1.0)
SIZES = ((320, 240), (160, 120), (80, 60), (40, 30))
HEADS = ("regression", "gaussian", "laplace", "categorical")
HISTOGRAMS = ("none", "equalise", "match")
GAINS = (0.5, 0.7, 1.0, 1.4, 2.0)


class Variant(NamedTuple):
    """A training, and how its network is judged."""

    seed: int
    model: str
    changes: tuple[tuple[str, str], ...]  # of the recipe
    judge: Callable[["Sets", Path], Row]


def folder(seed: int) -> Path:
    """Where the files of all studies with a seed are."""
    return WORK_DIR / "out" / "study" / str(seed)


class Sets(NamedTuple):
    """The random roads, divided by road, and the shipped roads, which are only tested."""

    random: Dataset
    unseen: Dataset


def study_sets(seed: int, roads: int = ROADS) -> Sets:
    """The drives as data sets, driven and built where they are missing."""
    return Sets(**demonstrations(folder(seed), roads=roads, seed=seed, jobs=os.cpu_count() or 1))


def trained_row(variant: Variant) -> Row:
    """Train a variant, unless its network is there, and judge it on the unseen roads."""
    sets = study_sets(variant.seed)
    out, recipe = _network(variant, sets), _recipe(variant)
    train_once(sets.random, variant.model, out, recipe, "trepid bench study")
    return variant.judge(sets, out)


def _recipe(variant: Variant) -> Recipe:
    return load_recipe(variant.model, None, overrides=dict(variant.changes))


def _network(variant: Variant, sets: Sets) -> Path:
    """The file of the network of a variant."""
    name = "_".join([variant.model, *(value for key, value in variant.changes if key != "stages")])
    digest = short_hash(
        code_of_training(variant.model), _recipe(variant).model_dump_json(), sets.random.sha256
    )
    return folder(variant.seed) / f"{name.replace('.', '-')}-{digest}.onnx"


def scores(sets: Sets, network: Path) -> Row:
    """Errors of the steering wheel on the unseen roads."""
    cv2.setNumThreads(1)
    bench, model = Bench(sets.unseen, "test", ratio=BIN_RATIO), JudgedModel(str(network))
    row = bench.row(model, model.predict(sets.unseen, bench.rows))
    kept = ("mae_deg", "rmse_deg", "r2", "rate_rms_degps", "latency_ms", "parameters")
    found = {name: row[name] for name in kept if name in row}
    found["always_straight_deg"] = row["baselines"]["always_straight"]["mae_deg"]
    return {name: round(value, 3) if isinstance(value, float) else value for name, value in found.items()}


def under_light(sets: Sets, network: Path) -> Row:
    """The errors, and the deviation of the steering wheel under GAINS of the brightness, root mean square [°]."""
    driver, spreads = DriverNetwork(network), []
    for image in sets.unseen.images(sets.unseen.rows("test")):
        angles = [
            driver(
                cv2.convertScaleAbs(image, alpha=gain).astype(np.uint8), driver.initial_state
            ).road_wheel_rad
            for gain in GAINS
        ]
        spreads.append(np.var(np.degrees(angles) * BIN_RATIO))
    spread_deg = round(float(np.sqrt(np.mean(spreads))), 3)
    return {"spread_under_light_deg": spread_deg} | scores(sets, network)


def _study(seed: int, name: str, variants: Mapping[str, Variant]) -> dict[str, Row]:
    need_torch(f"bench study {name}")
    sets = study_sets(seed)
    code = fingerprint(*import_closure(JUDGING), "config")
    codes = {
        case: short_hash(code, _network(variant, sets).name, sets.unseen.folder.name)
        for case, variant in variants.items()
    }
    rows = stored_rows(folder(seed) / f"{name}.jsonl", trained_row, dict(variants), codes=codes, jobs=1)
    return dict(zip(variants, rows, strict=True))


def _variant(
    seed: int, model: str = "steer", judge: Callable[[Sets, Path], Row] = scores, /, **changes: str
) -> Variant:
    recipe = {"seed": str(seed), "stages": one_stage(EPOCHS, RATE)} | changes
    return Variant(seed, model, tuple(recipe.items()), judge)


def bench_data(seed: int) -> Row:
    """Test error by the share of the training frames, with at most ten times the epochs for a smaller share.

    Each is the mean of TRAININGS trainings on the same drives, which differ in their random numbers: one training
    differs from another by as much as one share from the next. MOVED_SHARES are also learned with half of the
    frames seen from beside the path.
    """
    recipes = {f"{share:.0%}": _share(share) for share in SHARES}
    recipes |= {
        f"{share:.0%}, other viewpoints": _share(share) | {"augmentation.viewpoint": "0.5"}
        for share in MOVED_SHARES
    }
    trainings = range(1, TRAININGS + 1)
    variants = {
        f"{name}, training {number}": _variant(seed, **recipe, seed=str(seed + number - 1))
        for number in trainings
        for name, recipe in recipes.items()
    }
    rows = _study(seed, "data", variants)
    found = {
        name: {f"training {number}": rows[f"{name}, training {number}"] for number in trainings}
        for name in recipes
    }
    return {
        "share of the frames": {name: _mean(list(each.values())) for name, each in found.items()},
        "each training, mae_deg": {
            name: {training: row["mae_deg"] for training, row in each.items()} for name, each in found.items()
        },
    }


def _share(share: float) -> dict[str, str]:
    """The changes of the recipe for a share of the frames."""
    epochs = round(min(10 * EPOCHS, EPOCHS / share))
    return {"frames_share": str(share), "stages": one_stage(epochs, RATE)}


def _mean(rows: list[Row]) -> Row:
    """The means of the numbers of rows with the same fields; whole where all rows have the same one."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    return {
        name: found[0] if len(set(found)) == 1 else round(float(np.mean(found)), 3)
        for name, found in columns.items()
    }


def bench_size(seed: int) -> Row:
    """Test error by the size of the image."""
    variants = {
        f"{width}×{height}": _variant(seed, width_px=str(width), height_px=str(height))
        for width, height in SIZES
    }
    return {"size of the image": _study(seed, "size", variants)}


def bench_initialisation(seed: int) -> Row:
    """Test error by the first weights."""
    variants = {name: _variant(seed, initialisation=name) for name in ("network", "glorot", "he")}
    variants["auto-encoder first"] = _variant(seed, pretrain_epochs="4")
    return {"first weights": _study(seed, "initialisation", variants)}


def bench_heads(seed: int) -> Row:
    """Test error of an angle, of an angle with its error scale, and of 15 classes of angles (N23)."""
    variants = {head: _variant(seed, head=head, beta="1.0") for head in HEADS}
    return {"head": _study(seed, "heads", variants)}


def bench_histogram(seed: int) -> Row:
    """Test error and deviation under changed brightness, without and with histogram equalisation and matching.

    Each frame has mean 0 and deviation 1 before it reaches the layers of ``steer``; those of ``donkey-linear`` read
    the grey levels.
    """
    still = {f"augmentation.{name}": "0" for name in ("brightness", "shadow", "colour")}
    variants = {
        f"{model}, {name}{', light augmented' if changed else ''}": _variant(
            seed, model, under_light, histogram=name, **({} if changed else still)
        )
        for model, changed in (("steer", False), ("steer", True), ("donkey-linear", False))
        for name in HISTOGRAMS
    }
    return {"histogram": _study(seed, "histogram", variants)}
