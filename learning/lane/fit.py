"""Fit of the lane network to labelled frames. Needs torch (extra ``[train]``)."""

import copy
import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from learning.descent import ahead, descend, warm_up_cosine
from learning.lane.augment import Augmentation, Augmenter, nonsense
from learning.lane.frames import Mounts
from learning.lane.network import ExportedNetwork, SteerNetwork, loss
from learning.lane.scores import LabelledFrames, Prediction, PursuitTask
from learning.lane.unlabelled import (
    SelfTraining,
    UnlabelledFrames,
    label_by_network,
    label_by_teacher,
    none_of,
)
from learning.roadside import Scenery
from perception.lane.settings import steering_settings
from perception.net.canonical import MIRRORED
from perception.net.steer_net import Network
from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.files.whole import replacing
from trepid.types import NonNegative, Positive, Share

Count = Annotated[int, Field(ge=1)]
Batch = tuple[Tensor, Tensor, Tensor]
EVALUATION_BATCH = 256
LEAST_WIDTH_SPREAD_M = 0.05  # where all lanes have the same width


class Crop(Settings):
    """Rows of the default camera that are the input of the network, and its input size."""

    top_px: Annotated[int, Field(ge=0)]
    bottom_px: Count
    width_px: Count
    height_px: Count


class CarriagewayRecipe(Settings):
    """Section ``carriageway``: frames, training and size of the branch that measures roads without lines."""

    frames: Count
    frames_per_road: Count
    bare: Share
    both_ways: Share
    epochs: Count
    learning_rate: Positive
    channels: Count
    hidden: Count
    dropout: Share
    augmentation: Augmentation


class Recipe(Settings):
    """``config/train.yaml``."""

    seed: Annotated[int, Field(ge=0)]
    frames: Count
    validation_frames: Count
    test_frames: Count
    frames_per_road: Count
    epochs: Count
    batch: Count
    learning_rate: Positive
    weight_decay: NonNegative
    warm_up: Share
    beta: Share
    nonsense_share: Share
    patience: Count
    bfloat16: bool
    lane_lookahead_m: Positive
    tolerance_deg: Positive
    crop: Crop
    scenery: Scenery
    mounts: Mounts
    augmentation: Augmentation
    self_training: SelfTraining
    carriageway: CarriagewayRecipe | None = None  # not in files of 1.0


@dataclass(slots=True)
class Progress:
    """Progress of a training: the content of a checkpoint besides weights and optimiser."""

    epoch: int = 0
    best_epoch: int = 0
    best_loss: float = math.inf
    best_weights: dict[str, Tensor] | None = None
    elapsed_s: float = 0.0


def train(
    recipe: Recipe,
    data: LabelledFrames,
    validation: LabelledFrames,
    *,
    canonical: Camera,
    wheelbase_m: float,
    checkpoint: Path,
    resume: bool,
    report: Callable[[str], None],
    unlabelled: UnlabelledFrames | None = None,
) -> tuple[SteerNetwork, Progress]:
    """The network of the epoch with the least validation loss; ``canonical`` is the camera of all images.

    AdamW (Loshchilov and Hutter, ICLR 2019) with a cosine to zero. Every epoch draws its order and augmentation
    from (seed, epoch) alone and ends with a checkpoint, so a resumed training equals one in one go. The frames of
    ``unlabelled`` get their lanes before each later epoch (:mod:`learning.lane.unlabelled`).
    Raises InputError when the checkpoint is of another recipe, or of other frames without labels.
    """
    torch.manual_seed(recipe.seed)
    torch.set_num_threads(max(1, (os.cpu_count() or 1) - 1))  # one core augments
    network = build(recipe, data)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=recipe.learning_rate, weight_decay=recipe.weight_decay
    )
    drives = none_of(canonical) if unlabelled is None else unlabelled
    task = PursuitTask(wheelbase_m, network.command_row.double().numpy())
    kind = f"{recipe.model_dump_json()}{steering_settings().lookahead_m}{drives.digest}"
    progress = _restore(checkpoint, kind, network, optimiser) if resume else Progress()
    while progress.epoch < recipe.epochs and progress.epoch - progress.best_epoch < recipe.patience:
        started_s = time.monotonic()
        further = _label_drives(recipe, network, drives, task, progress.epoch)
        if len(drives):
            report(f"{len(further)} of {len(drives)} frames without labels have a lane")
        batches = _batches(recipe, canonical, data, further, progress.epoch)
        steps = math.ceil(len(data) / recipe.batch)
        train_loss = _epoch(recipe, network, optimiser, batches, steps=steps, epoch=progress.epoch)
        validation_loss = _evaluate(recipe, network, validation)
        progress.epoch += 1
        progress.elapsed_s += time.monotonic() - started_s
        if validation_loss < progress.best_loss:
            progress.best_loss, progress.best_epoch = validation_loss, progress.epoch
            progress.best_weights = copy.deepcopy(network.state_dict())
        _save(checkpoint, kind, network, optimiser, progress)
        report(_status(recipe, progress, train_loss, validation_loss))
    if progress.best_weights is not None:
        network.load_state_dict(progress.best_weights)
    return network.eval(), progress


def build(recipe: Recipe, data: LabelledFrames) -> SteerNetwork:
    """An untrained network whose outputs are in units of the spread of the lanes in ``data``.

    Their middle is that of a straight lane, of the mean width: a mirrored image has the mirrored lane.
    """
    lanes = data.lanes[data.visible].astype(float)
    middle = np.where(MIRRORED < 0, 0.0, lanes.mean(axis=0))
    spread = np.sqrt(np.mean((lanes - middle) ** 2, axis=0))
    spread[-1] = max(spread[-1], LEAST_WIDTH_SPREAD_M)
    ahead_m = recipe.lane_lookahead_m, steering_settings().lookahead_m
    return SteerNetwork(torch.from_numpy(middle), torch.from_numpy(spread), *ahead_m)


def largest_difference(network: SteerNetwork, exported: Network, images: np.ndarray) -> float:
    """Largest |torch − ONNX Runtime| over all outputs for ``images``: offset in m, angles in rad, and so on."""
    with torch.no_grad():
        wanted = ExportedNetwork(network).eval()(torch.from_numpy(images))
    return max(
        float(np.abs(w.numpy() - f).max())
        for w, f in zip(wanted, exported(images)[: len(wanted)], strict=True)
    )


def _label_drives(
    recipe: Recipe, network: SteerNetwork, drives: UnlabelledFrames, task: PursuitTask, epoch: int
) -> LabelledFrames:
    """The frames of ``drives`` with lanes by their teacher, else by ``network``, then none in the first epochs."""
    agree_rad = math.radians(recipe.self_training.agree_deg)
    if drives.taught is not None:
        return label_by_teacher(drives, task, agree_rad=agree_rad)
    early = epoch < recipe.self_training.after * recipe.epochs
    exported = ExportedNetwork(network.eval())

    def predict(images: np.ndarray) -> Prediction:
        parts = [images[i : i + EVALUATION_BATCH] for i in range(0, len(images), EVALUATION_BATCH)]
        with torch.no_grad():
            found = [exported(torch.from_numpy(part)) for part in parts]
        lanes, sigmas, visible = (torch.cat(column).numpy() for column in zip(*found, strict=True))
        return Prediction(lanes, task.wheelbase_m * sigmas.astype(float), visible.astype(float))

    chosen = UnlabelledFrames(drives.images[:0], drives.drives[:0]) if early else drives
    return label_by_network(predict, chosen, task, agree_rad=agree_rad)


def _epoch(
    recipe: Recipe,
    network: SteerNetwork,
    optimiser: torch.optim.Optimizer,
    batches: Iterator[Batch],
    *,
    steps: int,
    epoch: int,
) -> float:
    """One pass over ``batches``, of which there are ``steps``; returns the mean loss."""
    network.train()
    losses = []
    for step, (images, lanes, visible) in enumerate(ahead(batches)):
        done = (epoch + step / steps) / recipe.epochs
        rate = recipe.learning_rate * warm_up_cosine(done, warm_up=recipe.warm_up)
        value = loss(network, _raw(recipe, network, images), lanes, visible, beta=recipe.beta)
        losses.append(descend(network, optimiser, value, rate=rate))
    return float(np.mean(losses))


def _evaluate(recipe: Recipe, network: SteerNetwork, data: LabelledFrames) -> float:
    """Mean negative log likelihood over ``data`` without augmentation."""
    network.eval()
    parts = [slice(i, i + EVALUATION_BATCH) for i in range(0, len(data), EVALUATION_BATCH)]
    with torch.no_grad():
        raw = torch.cat([_raw(recipe, network, torch.from_numpy(data.images[part])) for part in parts])
        visible = torch.from_numpy(data.visible.astype(np.float32))
        return float(loss(network, raw, torch.from_numpy(data.lanes), visible, beta=0.0))


def _raw(recipe: Recipe, network: SteerNetwork, images: Tensor) -> Tensor:
    with torch.autocast("cpu", torch.bfloat16, enabled=recipe.bfloat16):
        return network(images).float()


def _batches(
    recipe: Recipe, canonical: Camera, data: LabelledFrames, further: LabelledFrames, epoch: int
) -> Iterator[Batch]:
    """Batches of all frames of ``data``, augmented; each also has images without a road and some of ``further``."""
    rng = np.random.default_rng((recipe.seed, epoch))
    augmenter = Augmenter(recipe.augmentation, canonical, lookahead_m=recipe.lane_lookahead_m)
    order = rng.permutation(len(data))
    extra = round(recipe.batch * recipe.nonsense_share)
    own = round(recipe.batch * recipe.self_training.share) if len(further) else 0
    for start in range(0, len(order), recipe.batch):
        chosen = order[start : start + recipe.batch]
        pairs = [augmenter(data.images[i], data.lanes[i], rng) for i in chosen]
        blank = np.zeros(data.lanes.shape[1], np.float32)
        for i in rng.choice(chosen, extra):
            pairs.append(augmenter(nonsense(data.images[i], rng), blank, rng))
        for i in rng.integers(0, len(further), own) if own else ():
            pairs.append(augmenter(further.images[i], further.lanes[i], rng))
        images, lanes = (np.stack(column) for column in zip(*pairs, strict=True))
        seen = [data.visible[chosen], np.zeros(extra, bool), np.ones(own, bool)]
        visible = np.concatenate(seen).astype(np.float32)
        yield torch.from_numpy(images), torch.from_numpy(lanes), torch.from_numpy(visible)


def _save(
    path: Path, kind: str, network: SteerNetwork, optimiser: torch.optim.Optimizer, progress: Progress
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = dict(
        recipe=kind,
        network=network.state_dict(),
        optimiser=optimiser.state_dict(),
        progress={name: getattr(progress, name) for name in Progress.__slots__},
    )
    with replacing(path) as fresh:
        torch.save(content, fresh)


def _restore(path: Path, kind: str, network: SteerNetwork, optimiser: torch.optim.Optimizer) -> Progress:
    if not path.is_file():
        return Progress()  # interrupted before the end of the first epoch
    saved: dict[str, Any] = torch.load(path, weights_only=True)
    if saved["recipe"] != kind:
        raise InputError(f"{path}: was made by another recipe, or with other drives; train without --resume")
    network.load_state_dict(saved["network"])
    optimiser.load_state_dict(saved["optimiser"])
    return Progress(**saved["progress"])


def _status(recipe: Recipe, progress: Progress, train_loss: float, validation_loss: float) -> str:
    left_s = (recipe.epochs - progress.epoch) * progress.elapsed_s / progress.epoch
    best = " best" if progress.best_epoch == progress.epoch else ""
    return (
        f"epoch {progress.epoch}/{recipe.epochs}  loss {train_loss:.3f}"
        f"  validation {validation_loss:.3f}{best}  at most {left_s / 60:.1f} min left"
    )
