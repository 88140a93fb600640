"""A trained network as one ONNX file with metadata, and its comparison with torch."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from learning.models.parts.network import ExportedNetwork, SteeringNetwork
from learning.training.frames import Frames
from learning.unlike import attach
from perception.net.session import open_session
from trepid.config import ROOT, InputError

MAX_DIFFERENCE = 1e-4  # of angles and deviations [rad] between torch and ONNX Runtime
COMPARED = 64
METADATA = "trepid"
OPSET = 17


def export(
    network: SteeringNetwork, path: Path, *, train: Frames, validation: Frames, metadata: dict[str, Any]
) -> float:
    """Write ``path``; the greatest difference between torch and ONNX Runtime [rad].

    Input: ``image`` uint8 (n, H, W, 3) BGR; outputs: ``road_wheel_rad``, ``sigma_rad``, ``unlike``, perhaps
    ``speed_mps``, (n,) each. With a memory also ``state`` (n, s), zeros at first, and ``next_state``. Raises
    InputError above MAX_DIFFERENCE.
    """
    fresh = path.with_name(f"{path.name}.new")
    network = network.cpu().eval()
    _write(network, fresh)
    before = 0 if network.memory is None else network.memory.in_a_row - 1
    attach(fresh, train.images, others=validation.images, before=before)
    difference = largest_difference(network, fresh, validation)
    if not difference <= MAX_DIFFERENCE:
        raise InputError(
            f"{fresh}: differs from the trained network by {difference:.2g} rad; not kept as {path.name}"
        )
    describe(fresh, metadata)
    fresh.replace(path)
    return difference


def largest_difference(
    network: SteeringNetwork, path: Path, frames: Frames, *, names: Sequence[str] | None = None
) -> float:
    """Greatest |torch − ONNX Runtime| of the outputs ``names``, default all, and of the next state.

    Over the first frames. It is relative to the greatest number of an output, where this is above 1: the numbers of
    a state have no bound.
    """
    exported = ExportedNetwork(network)
    names = exported.names if names is None else [*names, *([] if network.memory is None else ["next_state"])]
    images = frames.images[:COMPARED].copy()
    feeds: dict[str, Any] = {"image": images}
    inputs = [torch.from_numpy(images)]
    if network.memory is not None:
        state = (
            np.random.default_rng(0)
            .normal(0, 0.5, (len(images), network.memory.state_size))
            .astype(np.float32)
        )
        feeds["state"] = state
        inputs.append(torch.from_numpy(state))
    with torch.no_grad():
        wanted = dict(zip(exported.names, exported(*inputs), strict=True))
    found = open_session(path).run(names, feeds)
    pairs = ((wanted[name].numpy(), f) for name, f in zip(names, found, strict=True))
    return max(float(np.abs(w - f).max() / max(1.0, np.abs(w).max())) for w, f in pairs)


def origin_commit() -> str:
    """The commit of this checkout; "" where it is none."""
    if not (ROOT / ".git").exists():  # installed, perhaps below the checkout of something else
        return ""
    command = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def _write(network: SteeringNetwork, path: Path) -> None:
    exported = ExportedNetwork(network).eval()
    inputs, names = [torch.zeros(2, *network.size, 3, dtype=torch.uint8)], ["image"]
    if network.memory is not None:
        inputs.append(torch.zeros(2, network.memory.state_size))
        names.append("state")
    torch.onnx.export(
        exported,
        tuple(inputs),
        str(path),
        input_names=names,
        output_names=[*exported.names],
        dynamic_axes={name: {0: "n"} for name in (*names, *exported.names)},
        opset_version=OPSET,
        dynamo=False,
    )


def describe(path: Path, metadata: dict[str, Any]) -> None:
    """Store ``metadata`` as JSON in the properties of the file."""
    import onnx

    model = onnx.load(path)
    onnx.helper.set_model_props(model, {METADATA: json.dumps(metadata, ensure_ascii=False)})
    onnx.save(model, path)
