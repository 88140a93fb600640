"""Networks trained alike but for one thing, on simulated drives at 5 mph, judged on a route of no training set.

The frames come from the drives of ROUTES by Trepid itself. Drives, data sets, networks and rows are kept in
``out/study``, each under a hash of the code and of all else that it depends on; an interrupted study continues.
Degrees are of a steering wheel with the ratio 16, as in the paper.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from learning.dataset.build import built_once
from learning.dataset.dataset import Dataset, Split
from learning.judging.evaluate import BIN_RATIO, Bench
from learning.judging.predictions import Model
from learning.models.catalogue import MODELS
from learning.rendered import need_torch, say
from learning.training.recipe import Recipe, load_recipe
from perception.net.driver import DriverNetwork
from sim_harness.bench.control.speeds import MPH
from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from trepid.config import WORK_DIR

Row = dict[str, Any]
SPEED = {"speed_mps": str(5 * MPH)}
ROUTES: Mapping[str, Mapping[str, str]] = {  # scenario -> changes
    "circuit": {"distance_m": "300", "duration_s": "200"},
    "curve_left_r15": {"duration_s": "60"},
    "curve_right_r15": {"duration_s": "60"},
    "s_curve": {"duration_s": "105"},
}
TEST_ROUTE = "s_curve"
SHARES_OF = {  # train, validation and test of a data set
    "seen": {"train": 0.85, "validation": 0.15, "test": 0.0},
    "unseen": {"train": 0.0, "validation": 0.0, "test": 1.0},
}
DRIVING = ("sim_harness.lockstep.closed_loop", "sim_harness.lockstep.recording")
BUILDING, TRAINING = "learning.dataset.build", "learning.training.run"
JUDGING = (__name__, "learning.judging.evaluate")
"""The modules of each step; their code, and what they import, is in the names of its results."""
EPOCHS = 8
STAGE = "[{{name: all, part: all, epochs: {}, learning_rate: 1.0e-3, schedule: cosine, patience: 99}}]"
SHARES = (0.01, 0.03, 0.1, 0.3, 1.0)
SIZES = ((320, 240), (160, 120), (80, 60), (40, 30))
GAINS = (0.5, 0.7, 1.0, 1.4, 2.0)
OURS = ("steer", "pilotnet", "donkey-linear")
PAPER: Mapping[str, Row] = {  # tables 2 to 4, and section 5.2
    "InceptionV3, paper": {
        "train_deg": 2.96,
        "validation_deg": 3.08,
        "test_deg": 3.10,
        "unseen_deg": 4.25,
        "test_r2": 0.97,
    },
    "VGG16, paper": {
        "train_deg": 3.82,
        "validation_deg": 3.81,
        "test_deg": 3.88,
        "unseen_deg": 5.17,
        "test_r2": 0.94,
    },
    "VGG19, paper": {
        "train_deg": 4.33,
        "validation_deg": 4.29,
        "test_deg": 4.41,
        "unseen_deg": 5.05,
        "test_r2": 0.90,
    },
    "RNN, paper": {"train_deg": 2.51, "validation_deg": 2.64, "test_deg": 2.67, "unseen_deg": 3.82},
}


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
    """The drives to learn from, divided by time, and the route that is only tested."""

    seen: Dataset
    unseen: Dataset


def study_sets(seed: int) -> Sets:
    """The drives as data sets, driven and built where they are missing."""
    scenarios = {name: load_scenario(name, {**SPEED, **changes}) for name, changes in ROUTES.items()}
    code = fingerprint(*import_closure(DRIVING), "perception/weights", "config")
    drives = (
        folder(seed) / f"drives-{short_hash(code, *(one.model_dump_json() for one in scenarios.values()))}"
    )
    paths = {name: _recorded(scenario, drives / f"{name}.mcap", seed) for name, scenario in scenarios.items()}
    unseen = paths.pop(TEST_ROUTE)
    return Sets(_built("seen", [*paths.values()], seed), _built("unseen", [unseen], seed))


def _recorded(scenario: Scenario, path: Path, seed: int) -> Path:
    """The recording of a drive."""
    if path.is_file():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.unlink(missing_ok=True)
    with recording(partial, scenario) as witness:
        run(scenario, seed=seed, witness=witness)
    partial.replace(path)
    return path


def _built(name: str, paths: list[Path], seed: int) -> Dataset:
    """The data set of some recordings."""
    split = Split(by="time", seed=seed, gap_s=1.0, shares=SHARES_OF[name])  # type: ignore[arg-type]
    code = fingerprint(*import_closure([BUILDING]), "config")
    stems = [path.stem for path in paths]
    digest = short_hash(code, split.model_dump_json(), *stems, paths[0].parent.name)
    return built_once(folder(seed) / f"{name}-{digest}", paths, split)


def trained_row(variant: Variant) -> Row:
    """Train a variant, unless its network is there, and judge it on the test route."""
    from learning.training.run import run as train

    sets = study_sets(variant.seed)
    out, recipe = _network(variant, sets), _recipe(variant)
    if not out.with_suffix(".md").is_file():  # the card is written last
        train(sets.seen, variant.model, out, recipe, resume=True, command="trepid bench study", report=say)
    return variant.judge(sets, out)


def _recipe(variant: Variant) -> Recipe:
    return load_recipe(variant.model, None, overrides=dict(variant.changes))


def _network(variant: Variant, sets: Sets) -> Path:
    """The file of the network of a variant."""
    name = "_".join([variant.model, *(value for key, value in variant.changes if key != "stages")])
    code = fingerprint(
        *import_closure([TRAINING, f"learning.models.{MODELS[variant.model].module}"]), "config"
    )
    digest = short_hash(code, _recipe(variant).model_dump_json(), sets.seen.folder.name, sets.seen.sha256)
    return folder(variant.seed) / f"{name.replace('.', '-')}-{digest}.onnx"


def scores(sets: Sets, network: Path) -> Row:
    """Errors of the steering wheel on the unseen route."""
    return _errors(sets.unseen, network, "test")


def _errors(data: Dataset, network: Path, split: str) -> Row:
    bench, model = Bench(data, split, ratio=BIN_RATIO), Model(str(network))
    row = bench.row(model, model.predict(data, bench.rows))
    kept = ("mae_deg", "rmse_deg", "r2", "rate_rms_degps", "latency_ms", "parameters")
    found = {name: row[name] for name in kept if name in row}
    found["always_straight_deg"] = row["baselines"]["always_straight"]["mae_deg"]
    return {name: round(value, 3) if isinstance(value, float) else value for name, value in found.items()}


def all_splits(sets: Sets, network: Path) -> Row:
    """The errors in the layout of the paper's tables."""
    train, validation = (_errors(sets.seen, network, split) for split in ("train", "validation"))
    unseen = scores(sets, network)
    found = {"train_deg": train["mae_deg"], "validation_deg": validation["mae_deg"]}
    return found | {
        "unseen_deg": unseen["mae_deg"],
        "unseen_r2": unseen["r2"],
        "parameters": unseen["parameters"],
    }


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
    return scores(sets, network) | {"spread_under_light_deg": round(float(np.sqrt(np.mean(spreads))), 3)}


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
    seed: int, model: str = "steer", judge: Callable[[Sets, Path], Row] = scores, **changes: str
) -> Variant:
    recipe = {"seed": str(seed), "stages": STAGE.format(EPOCHS)} | changes
    return Variant(seed, model, tuple(recipe.items()), judge)


def bench_data(seed: int) -> Row:
    """Test error by the share of the training frames, with at most ten times the epochs for a smaller share."""
    stages = {share: STAGE.format(round(min(10 * EPOCHS, EPOCHS / share))) for share in SHARES}
    variants = {
        f"{share:.0%}": _variant(seed, frames_share=str(share), stages=stages[share], batch="32")
        for share in SHARES
    }
    return {"share of the frames": _study(seed, "data", variants)}


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


def bench_histogram(seed: int) -> Row:
    """Test error and deviation under changed brightness, without and with histogram equalisation and matching."""
    still = {f"augmentation.{name}": "0" for name in ("brightness", "shadow", "colour")}
    variants = {
        f"{name}{', light augmented' if changed else ''}": _variant(
            seed, judge=under_light, histogram=name, **({} if changed else still)
        )
        for changed in (False, True)
        for name in ("none", "equalise", "match")
    }
    return {"histogram": _study(seed, "histogram", variants)}


def bench_deep_steer(seed: int) -> Row:
    """Tables 2 to 4 of the paper beside networks of Trepid on its own drives."""
    variants = {model: _variant(seed, model, all_splits) for model in OURS}
    return {"mean absolute error": {**PAPER, **_study(seed, "deep-steer", variants)}}
