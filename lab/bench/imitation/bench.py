"""`trepid bench imitation`: networks that learn from drives, of the simulator and real ones.

The simulated part is :mod:`.harness`. Real drives: each network is judged on the last fifth of its own drive. The
networks of a set are trained on the same frames, with at most EPOCHS epochs and the seed of the recipe, and
judged beside predictions without an image. Data sets and weights stay in FOLDER: they are made of the sets, whose
licences do not permit distribution.
"""

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from lab.bench.imitation.harness import bench_harness
from lab.bench.imitation.training_code import code_of_training, train_once
from lab.bench.imitation.verdict import judge_simulation, verdicts
from lab.bench.real.sets import data_folder
from learning.dataset.build import BuildOptions, build, read_logs
from learning.dataset.dataset import CARD, Dataset, Split
from learning.dataset.sources.log import Faults, sha256_of_files
from learning.dataset.sources.table import TableOptions
from learning.dataset.wheel import WheelOptions
from learning.judging.evaluate import Bench
from learning.judging.predictions import JudgedModel
from learning.rendered import need_torch, say
from learning.training.recipe import Recipe, load_recipe
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import Row, stored_rows
from trepid.config import WORK_DIR, InputError

HARNESS = "harness"
SETS = ("donkey_sim_carpet", "udacity_sim_track", "running_track_cart", "donkey_indoor_track")
OURS, PEER = ("steer", "steer-motion"), "donkey-linear"
FOLDER = WORK_DIR / "out" / "bench_imitation"
EPOCHS, QUICK_EPOCHS = 15, 2
QUICK_SHARE = 0.25  # of the training frames
SPLIT = Split(by="time", seed=0, gap_s=2.0, shares={"train": 0.65, "validation": 0.15, "test": 0.2})


@dataclass(frozen=True, slots=True)
class DatasetTraining:
    """A network to train and judge on a data set."""

    data: Path
    network: str
    recipe: Recipe
    out: Path


def bench_imitation(
    *,
    seed: int,
    quick: bool = False,
    data: Path | None = None,
    sets: tuple[str, ...] = (),
    jobs: int | None = None,
) -> dict[str, Any]:
    """Tables of the simulator (:func:`bench_harness`; ``seed`` draws its roads), "last fifth" (set -> network or
    baseline -> scores; road wheel) and "figures" (results and aims).

    ``sets``: names among HARNESS and SETS; default: all. Stored rows are not computed again, and a training that
    was interrupted goes on. Raises InputError for an unknown set, and without torch.
    """
    for name in sets:
        if name not in (HARNESS, *SETS):
            raise InputError(f"no set {name!r} in bench imitation; there are {', '.join((HARNESS, *SETS))}")
    need_torch("bench imitation")
    tables: dict[str, Any] = {}
    if HARNESS in sets or not sets:
        tables = bench_harness(FOLDER / f"harness-{seed}", quick=quick, seed=seed, jobs=jobs or 1)
        tables["figures of the simulator"] = judge_simulation(tables)
    found, absent = {}, {}
    for name in sets or SETS:
        if name == HARNESS:
            continue
        folder = data_folder(data) / name
        if folder.is_dir():
            found[name] = build_dataset(folder)
        else:
            absent[name] = {"left out": f"no folder {name} in the data folder"}
    tasks = {
        f"{name}, {network}": _task(dataset, network, quick=quick)
        for name, dataset in found.items()
        for network in (PEER, *OURS)
    }
    judging = fingerprint(*import_closure(["learning.judging.evaluate", __name__]), "config")
    codes = {case: short_hash(task.out.stem, judging) for case, task in tasks.items()}
    rows = iter(stored_rows(FOLDER / "rows.jsonl", judge_training, tasks, codes=codes, jobs=jobs or 1))
    table: dict[str, dict[str, Row]] = {}
    for name, dataset in found.items():
        table[name] = {network: next(rows) for network in (PEER, *OURS)}
        table[name] |= Bench(dataset, "test").baselines
    if table:
        tables |= {"last fifth": table, "figures": verdicts(table, OURS, PEER)}
    return tables | absent


def build_dataset(source: Path) -> Dataset:
    """The data set of the real drive in ``source``, built once for each content and code."""
    faults = Faults(strict=False)
    logs = read_logs([source], faults, TableOptions())
    code = fingerprint(*import_closure(["learning.dataset.build"]))
    digest = short_hash(str(source), code, sha256_of_files(logs[0].files))
    folder = FOLDER / "sets" / f"{source.name}-{digest}"
    if not (folder / CARD).is_file():
        say(f"imitation: building {folder}")
        command = shlex.join(["trepid", "dataset", "build", str(folder), str(source)])
        build(folder, logs, BuildOptions(WheelOptions(), SPLIT, TableOptions(), command=command), faults)
    return Dataset.open(folder)


def _task(dataset: Dataset, network: str, *, quick: bool) -> DatasetTraining:
    recipe = load_recipe(network, None)
    epochs = QUICK_EPOCHS if quick else EPOCHS
    changed: dict[str, Any] = {
        "stages": tuple(
            stage.model_copy(update={"epochs": min(stage.epochs, epochs)}) for stage in recipe.stages
        )
    }
    if quick:
        changed["frames_share"] = QUICK_SHARE
    recipe = recipe.model_copy(update=changed)
    digest = short_hash(code_of_training(network), recipe.model_dump_json(), dataset.sha256)
    out = FOLDER / "weights" / f"{dataset.folder.name.rpartition('-')[0]}-{network}-{digest}.onnx"
    return DatasetTraining(dataset.folder, network, recipe, out)


def judge_training(task: DatasetTraining) -> Row:
    """Train a network, unless it is there, and score it on the test split."""
    dataset = Dataset.open(task.data)
    train_once(dataset, task.network, task.out, task.recipe, "trepid bench imitation")
    cv2.setNumThreads(1)
    bench, model = Bench(dataset, "test"), JudgedModel(str(task.out))
    row = bench.row(model, model.predict(dataset, bench.rows))
    curve = [
        json.loads(line)
        for line in task.out.with_name(f"{task.out.name}.train")
        .joinpath("curve.jsonl")
        .read_text()
        .splitlines()
    ]
    best = min(curve, key=lambda point: point["validation_mae_rad"])
    names = ("mae_deg", "rmse_deg", "mean_error_deg", "r2", "frames")
    low, high = row["intervals_95"]["mae_deg"] or (None, None)
    return {name: row[name] for name in names} | {
        "mae_95_from_deg": low,
        "mae_95_to_deg": high,
        "coverage_90": row["uncertainty"]["coverage_90"],
        "width_90_deg": row["uncertainty"]["mean_width_deg"],
        "rate_rms_degps": row["rate_rms_degps"],
        "latency_ms": row["latency_ms"],
        "weights": row["parameters"],
        "epochs": len(curve),
        "best_epoch": best["epoch"],
        "training_s": curve[-1]["elapsed_s"],
    }
