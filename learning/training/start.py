"""Weights that a training begins with: those of an earlier training, or those of a trunk from a file.

The ONNX file of an earlier training cannot give them: it holds folded constants. The checkpoint beside it holds the
weights of the best epoch. The file of a trunk has the public layout of torchvision: a dictionary of names to
tensors.
"""

import hashlib
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import torch
from torch import nn

from learning.models.catalogue import packaged_weights
from learning.models.parts.network import SteeringNetwork
from learning.training.checkpoint import Checkpoints
from learning.training.export import MAX_DIFFERENCE, largest_difference
from learning.training.frames import Frames
from learning.training.recipe import Recipe
from trepid.config import InputError

Report = Callable[[str], None]


def load_first_weights(
    name: str,
    network: SteeringNetwork,
    recipe: Recipe,
    validation: Frames,
    start: Path | None,
    report: Callable[[str], None],
) -> str:
    """Load all weights from the training of ``start``, else those of the trunk from a file; return their origin.

    The file is that of the recipe, or of the package of the network; without one the weights stay random.
    """
    if start is not None:
        load_start(network, start, validation, report)
        return origin_of(start)
    path = recipe.weights or packaged_weights(name)
    if path is None:
        return "random"
    load_trunk(network.trunk, path)
    return f"{path.name}, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()}"


def work_folder(weights: Path) -> Path:
    """The folder of the training of a weights file: checkpoints and learning curve."""
    return weights.with_name(f"{weights.name}.train")


def checkpoints_of(weights: Path) -> Checkpoints:
    """The checkpoints of the training of a weights file."""
    return Checkpoints(work_folder(weights) / "checkpoint")


def check_start(start: Path) -> None:
    """Raise InputError where the checkpoint of the network ``start`` is not beside it."""
    if not checkpoints_of(start).exist():
        raise InputError(
            f"{work_folder(start)}: no checkpoint of the training of {start.name}, and so no weights to begin"
            " with: bring this folder along with the file, or leave --start out to train from random weights"
        )


def copy_start(start: Path, out: Path) -> None:
    """Copy the network ``start`` with its checkpoints to ``out``. Raises InputError without a checkpoint."""
    check_start(start)
    shutil.copyfile(start, out)
    work_folder(out).mkdir(parents=True, exist_ok=True)
    before, after = checkpoints_of(start), checkpoints_of(out)
    for source, target in ((before.before, after.before), (before.path, after.path)):
        if source.is_file():
            shutil.copyfile(source, target)


def load_start(network: SteeringNetwork, start: Path, frames: Frames, report: Report) -> None:
    """Give ``network`` all weights of ``start``, and its unit of angles.

    Raises InputError where they are missing, belong to another network, or steer the first of ``frames`` otherwise
    than the file ``start`` does.
    """
    check_start(start)
    saved = checkpoints_of(start).load(report)
    best = None if saved is None else saved["best"]
    if best is None:
        raise InputError(f"{work_folder(start)}: its training has not finished an epoch")
    try:
        network.load_state_dict(best)
    except RuntimeError as error:
        what = " ".join(str(error).split())[:200]
        raise InputError(f"{start}: another network or size than the one to train: {what}") from error
    network.eval()
    with torch.no_grad():
        difference = largest_difference(network, start, frames, names=("road_wheel_rad",))
    network.train()
    if not difference <= MAX_DIFFERENCE:
        raise InputError(
            f"{start}: steers otherwise than the weights in {work_folder(start)}, by {difference:.2g} rad: the"
            " folder is of another training or recipe"
        )


def origin_of(start: Path) -> str:
    """The words of the model card for the first weights."""
    return f"all of {start.name}, sha256 {hashlib.sha256(start.read_bytes()).hexdigest()}"


def load_trunk(trunk: nn.Module, path: Path) -> None:
    """Load all weights of ``trunk`` from ``path``; those of a classifier in the file are not used.

    Raises InputError when the file is no dictionary of tensors, or lacks one, or has one of another shape.
    """
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (
        RuntimeError,
        EOFError,
        LookupError,
        ValueError,
        pickle.UnpicklingError,
        zipfile.BadZipFile,
    ) as error:
        raise InputError(f"{path}: no file of weights: {' '.join(str(error).split())[:200]}") from error
    if not isinstance(found, dict) or not all(isinstance(one, torch.Tensor) for one in found.values()):
        raise InputError(f"{path}: no dictionary of names to tensors, as torchvision's state_dict")
    wanted = trunk.state_dict()
    for name, tensor in wanted.items():
        if name.endswith("num_batches_tracked"):
            continue
        if name not in found:
            raise InputError(
                f"{path}: no weights {name!r}; expected the layout of torchvision for this network"
            )
        if found[name].shape != tensor.shape:
            shapes = f"{tuple(found[name].shape)}, expected {tuple(tensor.shape)}"
            raise InputError(f"{path}: {name!r} has the shape {shapes}")
    trunk.load_state_dict({name: found.get(name, tensor) for name, tensor in wanted.items()})
