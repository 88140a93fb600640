"""A training from data set to weights file. Needs torch (extra ``[train]``)."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch

from learning.dataset.dataset import Dataset
from learning.judging.baselines import Baselines, no_variance
from learning.models.catalogue import build
from learning.models.parts.network import SteeringNetwork, glorot, he
from learning.rendered import VERSIONS
from learning.training.augmentation import Augmenter
from learning.training.batches import Batches
from learning.training.calibrate import error_scores, interval, set_sigma, speed_scores
from learning.training.card import check_card, write_card, write_curve
from learning.training.checkpoint import Checkpoints
from learning.training.export import export, origin_commit
from learning.training.frames import Frames, forget_frames, read_frames, share_of
from learning.training.labels import training_labels, weights
from learning.training.loop import Progress, Trainer, predict, predict_speeds
from learning.training.pretrain import pretrain
from learning.training.recipe import Recipe
from learning.training.start import check_start, checkpoints_of, load_first_weights, origin_of, work_folder
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.types import Floats

HISTOGRAM_FRAMES = 500
LEAST_SPREAD_MPS = 0.01


class Training(NamedTuple):
    """A network with the weights of its best epoch, and what it learned from."""

    network: SteeringNetwork
    train: Frames
    validation: Frames
    progress: Progress
    trunk: str  # the origin of the first weights of the trunk
    device: torch.device


def train_network(
    data: Dataset,
    name: str,
    out: Path,
    recipe: Recipe,
    *,
    resume: bool,
    report: Callable[[str], None],
    start: Path | None = None,
) -> Training:
    """Train the network ``name`` on the GPU that torch sees, else on the CPU. Raises InputError.

    The folder ``out`` + ``.train`` holds the frames, the checkpoints, and the learning curve. ``start``: the
    network whose weights are the first ones; None: those of the recipe.
    """
    work, checkpoints = work_folder(out), checkpoints_of(out)
    if start is not None:
        check_start(start)
    if not resume:
        _check_unfinished(checkpoints, report)
    torch.manual_seed(recipe.seed)
    torch.set_num_threads(recipe.threads)
    network = build(name, height=recipe.height_px, width=recipe.width_px, head=recipe.head)
    train, validation = (
        read_frames(data, split, **network.size._asdict(), folder=work, report=report)
        for split in ("train", "validation")
    )
    train = Frames(train.images, training_labels(data, recipe), *train[2:])
    prepare(network, recipe, train, lock_rad=data.wheel.lock_rad)
    for finding in no_variance(train.labels_rad, "train"):
        report(f"finding: {finding.sentence}")
    trunk = load_first_weights(name, network, recipe, validation, start, report)
    report(f"{name}: {network.parameters_count} weights, those of the trunk at first {trunk}")
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    trainer = Trainer(
        recipe=recipe,
        network=network.to(device),
        batches=batches_of(recipe, network, train, report),
        validation=validation,
        checkpoints=checkpoints,
        identity=_identity(name, recipe, data.sha256, start),
        report=report,
        on_epoch=lambda progress: write_curve(progress, work),
    )
    if start is not None:
        trainer.keep_first()
    elif recipe.pretrain_epochs and not (resume and checkpoints.exist()):
        early = Checkpoints(work / "auto-encoder")
        pretrain(network, recipe, train, early, trainer.identity, report, resume=resume)
    return Training(network, train, validation, trainer.run(resume=resume), trunk, device)


def run(
    data: Dataset,
    name: str,
    out: Path,
    recipe: Recipe,
    *,
    resume: bool,
    command: str,
    report: Callable[[str], None],
    start: Path | None = None,
) -> dict[str, Any]:
    """:func:`train_network`, and write ``out`` with its card; the metadata of the file. Raises InputError.

    The frames are removed at the end. The metadata have the ``findings`` and the ``conclusion`` of the validation
    frames (:mod:`learning.judging.baselines`).
    """
    check_card(out.with_suffix(".md"))
    training = train_network(data, name, out, recipe, resume=resume, report=report, start=start)
    network, train, validation = training.network, training.train, training.validation
    set_sigma(network, validation)
    metadata = dict(_metadata(data, name, network, recipe, train, validation), trunk=training.trunk)
    metadata |= _learning(data, train, predict(network, validation)[0])
    difference = export(network, out, train=train, validation=validation, metadata=metadata)
    write_card(
        out.with_suffix(".md"),
        metadata,
        recipe,
        training.progress,
        _facts(data, command, training.progress, training.device, difference),
    )
    for split in ("train", "validation"):
        forget_frames(split, work_folder(out))
    return metadata


def prepare(network: SteeringNetwork, recipe: Recipe, train: Frames, *, lock_rad: float | None) -> None:
    """Unit, dropout, memory, speed output, first weights and reference histogram of an untrained network.

    Raises InputError where there is nothing to learn.
    """
    greatest = lock_rad or float(np.abs(train.labels_rad).max())
    spread = float(np.sqrt(np.mean(train.labels_rad.astype(float) ** 2)))
    units = dict(rad=1.0, lock=greatest, spread=spread)
    if recipe.head == "categorical":
        units["spread"] = greatest  # its bins end at 1
    if not units[recipe.unit] > 0:
        raise InputError("all labels of the training frames are zero: nothing to learn")
    network.scale_rad.fill_(units[recipe.unit])
    for layer in network.modules():
        if isinstance(layer, torch.nn.Dropout) and recipe.dropout is not None:
            layer.p = recipe.dropout
    if network.memory is not None:
        network.memory.remember(recipe.window)
    network.stride = recipe.stride
    if recipe.speed:
        network.add_speed(*_mean_and_spread(train))
    if recipe.initialisation != "network":
        dict(glorot=glorot, he=he)[recipe.initialisation](network)
    network.view.histogram = recipe.histogram
    if recipe.histogram == "match":
        chosen = train.images[np.linspace(0, len(train) - 1, min(HISTOGRAM_FRAMES, len(train))).astype(int)]
        chosen = chosen[:, network.view.crop_px :]  # the view matches what it cuts out
        grey = np.concatenate([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).ravel() for image in chosen])
        network.view.match(np.bincount(grey, minlength=256))


def _mean_and_spread(train: Frames) -> tuple[float, float]:
    """Of the recorded speeds [m/s]; a deviation of LEAST_SPREAD_MPS at least. Raises InputError without a speed."""
    known = np.empty(0) if train.speeds_mps is None else train.speeds_mps[np.isfinite(train.speeds_mps)]
    if not len(known):
        raise InputError("speed: true, and no training frame has a recorded speed: nothing to learn")
    return float(known.mean()), max(float(known.std()), LEAST_SPREAD_MPS)


def batches_of(
    recipe: Recipe, network: SteeringNetwork, train: Frames, report: Callable[[str], None]
) -> Batches:
    """The batches of the training frames; none is mirrored where their labels lie to one side.

    Raises InputError when a memory needs longer pieces, or another window or stride.
    """
    recurrent = network.memory is not None
    least = 1 if network.memory is None else network.memory.in_a_row
    if least > 1 and (recipe.window < least or recipe.stride != 1):
        raise InputError(
            f"window {recipe.window}, stride {recipe.stride}: the shift of the view needs a window of"
            f" {least} frames at least, and a stride of 1"
        )
    places = train.windows(recipe.window if recurrent else 1, recipe.stride)
    if len(places):
        places = places[share_of(len(places), recipe.frames_share)]
    else:
        raise InputError(
            f"no piece of the training frames without a gap is {recipe.window} frames x {recipe.stride} long"
        )
    changes = recipe.augmentation
    labels_rad = train.labels_rad.astype(float)
    mean_rad, rms_rad = abs(labels_rad.mean()), math.sqrt(np.mean(labels_rad**2))
    if mean_rad > recipe.flip_bias * rms_rad and changes.flip:
        report(f"no frame is mirrored: |mean|/rms of the labels is {mean_rad / rms_rad:.2f}")
        changes = changes.model_copy(update={"flip": 0.0})
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    return Batches(
        frames=train,
        places=places,
        weights=weights(labels_rad, bins=recipe.balance_bins, power=recipe.balance).astype(np.float32),
        size=recipe.batch,
        seed=recipe.seed,
        augment=Augmenter(changes, camera, wheelbase_m=vehicle.wheelbase_m),
        recurrent=recurrent,
    )


def _check_unfinished(checkpoints: Checkpoints, report: Callable[[str], None]) -> None:
    """Raise InputError where a training has begun and not ended."""
    if checkpoints.exist():
        saved = checkpoints.load(report)
        if saved is not None and not saved["progress"]["finished"]:
            raise InputError(
                f"{checkpoints.path.parent}: a training has begun here: --resume continues it; remove the folder,"
                " or name another --out"
            )


def _learning(data: Dataset, train: Frames, validation_rad: Floats) -> dict[str, Any]:
    """Findings of the training and the validation frames, and the conclusion."""
    learning = Baselines(data, "validation").learning(validation_rad.astype(float))
    found = [*no_variance(train.labels_rad, "train"), *learning.findings]
    return {"findings": [asdict(one) for one in found], "conclusion": learning.conclusion}


def _identity(name: str, recipe: Recipe, data_sha256: str, start: Path | None) -> str:
    """Hash of all that decides about the weights: camera and wheelbase do by the changes of the frames."""
    car = (load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    parts = [name, recipe.model_dump_json(), data_sha256, *(part.model_dump_json() for part in car)]
    parts += [origin_of(start)] if start is not None else []
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def _metadata(
    data: Dataset, name: str, network: SteeringNetwork, recipe: Recipe, train: Frames, validation: Frames
) -> dict[str, Any]:
    return dict(
        kind="steering",
        model=name,
        parameters=network.parameters_count,
        height=network.size.height,
        width=network.size.width,
        data_sha256=data.sha256,
        lock_rad=data.wheel.lock_rad,
        interval_90=interval(network, validation),
        commit=origin_commit(),
        scores=error_scores(predict(network, validation)[0], validation.labels_rad)
        | _speed_scores(network, train, validation),
        speed=network.speed is not None,
        trained_on=list(train.routes),
        licence=sorted({source.licence for source in data.file.sources if source.licence}),
        head=recipe.head,
        stride=recipe.stride,
    )


def _speed_scores(network: SteeringNetwork, train: Frames, validation: Frames) -> dict[str, float]:
    """Errors of the proposed speeds of the validation frames; {} for a network without a speed."""
    if network.speed is None:
        return {}
    return speed_scores(predict_speeds(network, validation), train, validation)


def _facts(
    data: Dataset, command: str, progress: Progress, device: torch.device, difference: float
) -> dict[str, Any]:
    lock_rad = data.wheel.lock_rad
    return {
        "command": f"`{command}`",
        "data set": f"{data.folder}, sha256 {data.sha256}",
        "steering": data.wheel.how + (f"; lock {math.degrees(lock_rad):.2f}°" if lock_rad else ""),
        "split": f"by {data.file.split.by}, gap {data.file.split.gap_s:g} s",
        "commit": origin_commit() or "unknown",
        "trained": f"{progress.elapsed_s / 60:.1f} min on {device.type}",
        "versions": ", ".join(f"{one} {version(one)}" for one in VERSIONS),
        "torch against ONNX Runtime": f"at most {difference:.1e} rad",
    }
