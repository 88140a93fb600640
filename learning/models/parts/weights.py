"""Weights of a trunk from a file, in the public layout of torchvision: a dictionary of names to tensors."""

import pickle
import zipfile
from pathlib import Path

import torch
from torch import nn

from trepid.config import InputError


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
