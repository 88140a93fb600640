"""The networks of Deep Steer and of Trepid, trained on the same frames, beside the tables of the paper.

No package carries the ImageNet weights of InceptionV3 and VGG: their trunks begin with random weights, or with
those of an auto-encoder of the same frames, and so learn in one stage by Adam instead of two by RMSprop. The paper
drove each path in both directions: here half of the frames are mirrored. They have no other augmentation, and the
histogram matching of the paper. Where torch sees a GPU the frames have the size of the paper; without one they have
the REDUCED sizes, which two cores train in a night.

A night is long, and sizes that differ compare no networks: :func:`bench_trunks` trains all networks of the paper at
one small recipe, TRUNKS, with equal frames, pixels and epochs, in an hour and a half of one core. Sequences show
somewhat fewer frames, since none passes the end of a drive.
"""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lab.bench.imitation.training_code import code_of_training, one_stage
from lab.bench.study.learned import JUDGING, Row, Sets, folder, study_sets
from learning.dataset.dataset import Dataset
from learning.judging.evaluate import BIN_RATIO
from learning.judging.scores import errors
from learning.rendered import need_torch, say
from learning.training.frames import Frames, forget_frames, read_frames, share_of
from learning.training.recipe import Recipe, load_recipe
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows

if TYPE_CHECKING:
    from learning.models.parts.network import SteeringNetwork

_AS_PAPER = {"first weights": "ImageNet", "recipe": "RMSprop, two stages", "frame": "320×240"}
PAPER: Mapping[str, Row] = {  # tables 2 to 4, and section 5.2
    "InceptionV3, paper": {
        "train_deg": 2.96,
        "validation_deg": 3.08,
        "test_deg": 3.10,
        "unseen_deg": 4.25,
        "train_r2": 0.97,
        "validation_r2": 0.97,
        "test_r2": 0.97,
        **_AS_PAPER,
    },
    "VGG16, paper": {
        "train_deg": 3.82,
        "validation_deg": 3.81,
        "test_deg": 3.88,
        "unseen_deg": 5.17,
        "train_r2": 0.95,
        "validation_r2": 0.94,
        "test_r2": 0.94,
        **_AS_PAPER,
    },
    "VGG19, paper": {
        "train_deg": 4.33,
        "validation_deg": 4.29,
        "test_deg": 4.41,
        "unseen_deg": 5.05,
        "train_r2": 0.91,
        "validation_r2": 0.90,
        "test_r2": 0.90,
        **_AS_PAPER,
    },
    "RNN, paper": {
        "train_deg": 2.51,
        "validation_deg": 2.64,
        "test_deg": 2.67,
        "unseen_deg": 3.82,
        **_AS_PAPER,
    },
}

REDUCED: Mapping[str, tuple[int, int]] = {  # network -> width, height [px] on a CPU
    "inception-v3": (128, 96),
    "vgg16": (64, 48),
    "vgg19": (64, 48),
    "inception-rnn-as-printed": (128, 96),
    "inception-rnn": (128, 96),
}
EPOCHS = {"cuda": 12, "cpu": 8}
TRUNK_ROADS = 24
TRUNK_EPOCHS = 20
TRUNK_BATCH = 16  # frames
TRUNK_FRAMES_SHARE = 1.0
JOBS = {"cuda": 4, "cpu": 1}  # trainings at a time
RATE, RATE_VGG = 1.0e-3, 1.0e-4  # VGG has no batch normalisation
RATE_SMALL = 2.0e-4  # of InceptionV3 at TRUNKS: with RATE it answers every frame alike
WINDOW = 8  # frames of a sequence
PRETRAIN_EPOCHS = 4
AUTO_ENCODER = "inception-v3, auto-encoder first"
_OFF = dict.fromkeys(("brightness", "colour", "shadow", "blur", "noise", "erase", "flicker"), "0")
OF_PAPER: dict[str, str] = {
    "batch": "32",
    "optimiser": "adam",
    "unit": "spread",
    **{f"augmentation.{name}": share for name, share in _OFF.items()},
}
NETWORKS: Mapping[str, Mapping[str, str]] = {  # row -> changes of the recipe
    "vgg19": OF_PAPER | {"initialisation": "he"},
    "vgg16": OF_PAPER | {"initialisation": "he"},
    # as many sequences as frames would show each frame WINDOW times in an epoch
    "inception-rnn": OF_PAPER | {"batch": "8", "window": str(WINDOW), "frames_share": str(1 / WINDOW)},
    AUTO_ENCODER: OF_PAPER | {"pretrain_epochs": str(PRETRAIN_EPOCHS)},
    "inception-rnn-as-printed": OF_PAPER,
    "inception-v3": OF_PAPER,
    "steer": {},
    "pilotnet": {},
    "donkey-linear": {},
}
"""In the order of the trainings: the longest first."""
_TRUNKS = {
    "width_px": "80",  # the trunk of InceptionV3 reads no frame below 75×75
    "height_px": "80",
    "mixed_precision": "always",  # halves the time of VGG on a CPU with bfloat16
    "batch": str(TRUNK_BATCH),
    "frames_share": str(TRUNK_FRAMES_SHARE),
}
TRUNKS: Mapping[str, Mapping[str, str]] = {  # row -> changes of the recipe
    "steer": OF_PAPER | _TRUNKS,
    "inception-v3": OF_PAPER | _TRUNKS,
    "inception-rnn-as-printed": OF_PAPER | _TRUNKS,
    "inception-rnn": OF_PAPER
    | _TRUNKS
    | {
        "window": str(WINDOW),
        "batch": str(TRUNK_BATCH // WINDOW),
        "frames_share": str(TRUNK_FRAMES_SHARE / WINDOW),
    },
    "vgg16": OF_PAPER | _TRUNKS | {"initialisation": "he"},
    "vgg19": OF_PAPER | _TRUNKS | {"initialisation": "he"},
}
"""The networks of the paper and a small one, on frames of one size. In the order of the trainings."""


class Contestant(NamedTuple):
    """A training: its network, its recipe, the folders of its data sets, and where its checkpoints are."""

    model: str
    changes: tuple[tuple[str, str], ...]  # of the recipe
    random: Path
    unseen: Path
    checkpoints: Path

    @property
    def recipe(self) -> Recipe:
        """The recipe with the changes."""
        return load_recipe(self.model, None, overrides=dict(self.changes))


def changes_of(row: str, seed: int, device: str) -> dict[str, str]:
    """The changes of the recipe of a row for a device, "cuda" or "cpu"."""
    model = model_of(row)
    found = {"seed": str(seed), "stages": one_stage(EPOCHS[device], rate_of(model)), **NETWORKS[row]}
    if device == "cpu" and model in REDUCED:
        width_px, height_px = REDUCED[model]
        found |= {"width_px": str(width_px), "height_px": str(height_px)}
    return found


def trunk_changes_of(row: str, seed: int) -> dict[str, str]:
    """The changes of the recipe of a row of TRUNKS, on every device."""
    rate = RATE_SMALL if row.startswith("inception") else rate_of(row)
    return {"seed": str(seed), "stages": one_stage(TRUNK_EPOCHS, rate), **TRUNKS[row]}


def rate_of(model: str) -> float:
    """The learning rate of a network."""
    return RATE_VGG if model.startswith("vgg") else RATE


def model_of(row: str) -> str:
    """The network of a row."""
    return row.partition(",")[0]


def trainings(
    sets: Sets, seed: int, device: str, changes: Mapping[str, Mapping[str, str]]
) -> tuple[dict[str, Contestant], dict[str, str]]:
    """The training of each row on a device, and the hash of all that its scores depend on.

    ``changes``: row -> those of its recipe.
    """
    code = fingerprint(*import_closure([__name__, *JUDGING]), "config")
    tasks, codes = {}, {}
    for row, changed in changes.items():
        model = model_of(row)
        recipe = load_recipe(model, None, overrides=dict(changed))
        digest = short_hash(code_of_training(model), recipe.model_dump_json(), sets.random.sha256)
        folders = (sets.random.folder, sets.unseen.folder, folder(seed) / f"{model}-{digest}")
        tasks[row] = Contestant(model, tuple(changed.items()), *folders)
        codes[row] = short_hash(code, digest, sets.unseen.folder.name, device)
    return tasks, codes


def bench_deep_steer(seed: int) -> Row:
    """Tables 2 to 4 of the paper beside its networks and those of Trepid, trained on the same frames.

    A GPU is shared by JOBS trainings.
    """
    need_torch("bench study deep-steer")
    device, sets = device_name(), study_sets(seed)
    changes = {row: changes_of(row, seed, device) for row in NETWORKS}
    return _table(sets, seed, changes, "deep-steer", jobs=JOBS[device])


def bench_trunks(seed: int, *, quick: bool = False) -> Row:
    """The networks of the paper and a small one with equal frames, pixels and epochs, beside the paper's rows.

    One training at a time, on a GPU too. ``quick``: without VGG16 and VGG19, which take two thirds of the time.
    """
    need_torch("bench study trunks")
    sets = study_sets(seed, roads=TRUNK_ROADS)
    rows = [row for row in TRUNKS if not (quick and row.startswith("vgg"))]
    return _table(sets, seed, {row: trunk_changes_of(row, seed) for row in rows}, "trunks", jobs=1)


def device_name() -> str:
    """That of a training, "cuda" or "cpu"."""
    import torch

    return "cuda" if torch.cuda.is_available() else "cpu"


def _table(sets: Sets, seed: int, changes: Mapping[str, Mapping[str, str]], name: str, *, jobs: int) -> Row:
    tasks, codes = trainings(sets, seed, device_name(), changes)
    rows = stored_rows(folder(seed) / f"{name}.jsonl", trained_row, tasks, codes=codes, jobs=jobs)
    found = dict(zip(tasks, rows, strict=True))
    return {"mean absolute error": {**PAPER, "always straight": straight_row(sets), **found}}


def straight_row(sets: Sets) -> Row:
    """The errors of a steering wheel that is held straight, in all splits."""
    return {
        f"{name}_deg": round(
            math.degrees(float(np.abs(data.labelled_rows(split)["road_wheel_rad"]).mean())) * BIN_RATIO, 3
        )
        for name, data, split in judged_splits(sets.random, sets.unseen)
    }


def judged_splits(random: Dataset, unseen: Dataset) -> list[tuple[str, Dataset, str]]:
    """Name of the scores, data set, split."""
    return [
        *((split, random, split) for split in ("train", "validation", "test")),
        ("unseen", unseen, "test"),
    ]


def trained_row(one: Contestant) -> Row:
    """Train a network, from its last checkpoint on, and the errors of the steering wheel in all splits.

    A training whose loss leaves the finite numbers has the row that says so.
    """
    import torch

    from learning.training.loop import Divergence, predict
    from learning.training.run import train_network
    from learning.training.start import work_folder

    recipe, sets = one.recipe, (Dataset.open(one.random), Dataset.open(one.unseen))
    stage = recipe.stages[0]
    found: Row = {
        "first weights": f"auto-encoder, {recipe.pretrain_epochs} epochs"
        if recipe.pretrain_epochs
        else "random",
        "recipe": f"{recipe.optimiser} {stage.learning_rate:g}, {stage.epochs} epochs, batches of {recipe.batch}",
        "device": torch.cuda.get_device_name() if torch.cuda.is_available() else f"{os.cpu_count()} cores",
    }
    try:
        training = train_network(sets[0], one.model, one.checkpoints, recipe, resume=True, report=say)
    except Divergence as error:
        return found | {"failed": str(error)}
    size, unit_deg = training.network.size, math.degrees(BIN_RATIO)
    for name, data, split in judged_splits(*sets):
        kept = work_folder(one.checkpoints) / data.folder.name
        frames = read_frames(data, split, **size._asdict(), folder=kept, report=say)
        angles_rad, _ = predict(training.network, frames)
        row = errors(angles_rad.astype(float) * unit_deg, frames.labels_rad.astype(float) * unit_deg)
        found |= {f"{name}_{score}": round_score(row[of]) for score, of in (("deg", "mae_deg"), ("r2", "r2"))}
        forget_frames(split, kept)
    for split in ("train", "validation"):
        forget_frames(split, work_folder(one.checkpoints))
    return found | {
        "frame": f"{size.width}×{size.height}",
        "frames": frames_of_epoch(training.train, training.network, recipe),
        "parameters": training.network.parameters_count,
        "minutes": round(training.progress.elapsed_s / 60, 1),
    }


def round_score(value: float | None) -> float | None:
    """``value`` to three decimals; None stays."""
    return None if value is None else round(value, 3)


def frames_of_epoch(train: Frames, network: "SteeringNetwork", recipe: Recipe) -> int:
    """How many frames an epoch shows; those of overlapping sequences count in each of them."""
    window = 1 if network.memory is None else recipe.window
    return window * len(share_of(len(train.windows(window, recipe.stride)), recipe.frames_share))
