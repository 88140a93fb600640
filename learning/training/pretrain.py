"""Pre-training of a trunk as an auto-encoder: no labels are needed (N11)."""

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from learning.models.parts.network import SteeringNetwork
from learning.training.batches import seed_step
from learning.training.checkpoint import Checkpoints
from learning.training.frames import Frames
from learning.training.recipe import Recipe
from trepid.config import InputError

INNER = 32
PRETRAINING = 1_000_000  # epochs of this part, for random numbers of its own


class Decoder(nn.Module):
    """Features of the trunk (n, c, h, w) to frames (n, 3, H, W): upsampling in two steps, a convolution in each."""

    def __init__(self, channels: int, height: int, width: int) -> None:
        super().__init__()
        middle = (math.ceil(height / 4), math.ceil(width / 4))
        self.layers = nn.Sequential(
            nn.Upsample(middle, mode="bilinear"),
            nn.Conv2d(channels, INNER, 3, padding=1),
            nn.ReLU(),
            nn.Upsample((height, width), mode="bilinear"),
            nn.Conv2d(INNER, 3, 3, padding=1),
        )

    def forward(self, features: Tensor) -> Tensor:
        return self.layers(features)


def pretrain(
    network: SteeringNetwork,
    recipe: Recipe,
    frames: Frames,
    checkpoints: Checkpoints,
    identity: str,
    report: Callable[[str], None],
    *,
    resume: bool,
) -> None:
    """Train the trunk to reproduce what the view gives it, the least mean square error; the decoder is dropped.

    A checkpoint after every epoch. Raises InputError for a network without convolutions, and for a checkpoint of
    another training (``identity``).
    """
    device = network.scale_rad.device
    with torch.no_grad():
        seen = network.view(torch.from_numpy(frames.images[:1].copy()).to(device))
        features = network.eval().trunk(seen)
    if features.dim() != 4 or features is seen:
        raise InputError("pretrain_epochs: an auto-encoder needs a network with convolutions")
    torch.manual_seed(recipe.seed)
    decoder = Decoder(features.shape[1], *seen.shape[2:]).to(device)
    weights = [*network.trunk.parameters(), *decoder.parameters()]
    optimiser = torch.optim.Adam(weights, lr=recipe.pretrain_rate)
    network.train()
    parts = dict(network=network, decoder=decoder, optimiser=optimiser)
    saved = checkpoints.of(identity, report) if resume else None
    if saved is not None:
        for name, part in parts.items():
            part.load_state_dict(saved[name])
    for epoch in range(saved["epochs"] if saved else 0, recipe.pretrain_epochs):
        order = np.random.default_rng((recipe.seed, PRETRAINING, epoch)).permutation(len(frames))
        losses = []
        for step, start in enumerate(range(0, len(order), recipe.batch)):
            seed_step(recipe.seed, PRETRAINING + epoch, step)
            chosen = np.sort(order[start : start + recipe.batch])
            wanted = network.view(torch.from_numpy(frames.images[chosen]).to(device))
            rebuilt = decoder(network.trunk(wanted))
            if wanted.shape[1] != rebuilt.shape[1]:
                rebuilt = rebuilt.mean(1, keepdim=True)  # a grey view
            value = nn.functional.mse_loss(rebuilt, wanted)
            optimiser.zero_grad()
            value.backward()
            optimiser.step()
            losses.append(value.item())
        states = {name: part.state_dict() for name, part in parts.items()}
        checkpoints.save(dict(identity=identity, epochs=epoch + 1, **states))
        report(f"auto-encoder: epoch {epoch + 1}/{recipe.pretrain_epochs}  loss {np.mean(losses):.4f}")
