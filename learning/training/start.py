"""Weights that a training begins with: those of an earlier training, from the checkpoint beside its file.

The ONNX file cannot give them: it holds folded constants. The checkpoint holds the weights of the best epoch.
"""

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import torch

from learning.models.parts.network import SteeringNetwork
from learning.training.checkpoint import Checkpoints
from learning.training.export import MAX_DIFFERENCE, largest_difference
from learning.training.frames import Frames
from trepid.config import InputError

Report = Callable[[str], None]


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
