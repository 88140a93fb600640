"""Fit of the lead network to labelled strips. Needs torch (extra ``[train]``)."""

import math
import time
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.descent import descend, warm_up_cosine
from learning.lead.network import LeadNetwork, Targets, loss
from perception.lead.view import DISTANCES_M, RATIO, STRIPS, Strips

LEARNING_RATE, WEIGHT_DECAY, WARM_UP = 4e-3, 1e-4, 0.05
GOING_ON_RATE = 1e-3  # of a network that is trained already
BATCH, STEPS = 64, 400  # frames of a step; an epoch of many frames has this many steps, of larger batches
TINT_SIGMA, NOISE_GREY = 0.15, 6.0
AHEAD, LEFT = 0, 1  # columns of the label
STRIPS_PER_FRAME = 8  # used in an epoch: those with vehicles and some others
NEAR_STEPS = 2.5


def fit(
    strips: Strips,
    vehicles: NDArray[np.float32],
    *,
    epochs: int,
    seed: int,
    report: Callable[[str], None],
    device: str = "cpu",
    start: LeadNetwork | None = None,
) -> LeadNetwork:
    """A network fitted to frames (n, STRIPS, ROWS, COLUMNS, 3) and their vehicles (n, m, LABEL).

    AdamW (Loshchilov and Hutter, ICLR 2019) with one cosine to zero. Order and augmentation come from ``seed``. A
    GPU (``device`` "cuda") has to hold the frames in its memory; its sums differ in the last digits between runs.
    ``start``, a trained network, is fitted further at a lower rate.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, targets = (start or LeadNetwork()).to(device), Targets().to(device)
    highest = LEARNING_RATE if start is None else GOING_ON_RATE
    optimiser = torch.optim.AdamW(network.parameters(), lr=highest, weight_decay=WEIGHT_DECAY)
    images, labels = torch.from_numpy(strips).to(device), torch.from_numpy(vehicles).to(device)
    dice = torch.Generator(device).manual_seed(seed)
    batch = max(BATCH, len(strips) // STEPS)
    starts = range(0, len(strips), batch)
    started_s = time.monotonic()
    for epoch in range(epochs):
        losses = []
        order = torch.randperm(len(strips), generator=dice, device=device)
        for step, first in enumerate(starts):
            chosen = order[first : first + batch]
            seen, true, looked = _batch(images, labels[chosen], chosen, dice)
            rate = highest * warm_up_cosine((epoch + step / len(starts)) / epochs, warm_up=WARM_UP)
            raw = network(seen.flatten(0, 1)).unflatten(0, seen.shape[:2])
            row = torch.arange(len(looked), device=device)[:, None]
            value = loss(raw, *(wanted[row, looked] for wanted in targets(true)))
            losses.append(descend(network, optimiser, value, rate=rate))
        left_s = (time.monotonic() - started_s) * (epochs - epoch - 1) / (epoch + 1)
        report(f"epoch {epoch + 1}/{epochs}  loss {np.mean(losses):.3f}  {left_s / 60:.1f} min left")
    return network.cpu().eval()


def _batch(
    images: Tensor, labels: Tensor, chosen: Tensor, dice: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Some strips of the frames ``chosen``, half of them mirrored, all tinted and noisy; labels; which strips."""
    device, frames = images.device, len(chosen)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(shape, generator=dice, device=device)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=dice, device=device)

    looked = _choose_strips(labels, uniform(frames, STRIPS))
    seen = images[chosen[:, None], looked].to(torch.float32)
    flipped = uniform(frames) < 0.5
    seen = torch.where(flipped[:, None, None, None, None], seen.flip(3), seen)
    labels = labels.clone()
    labels[flipped, :, LEFT] *= -1
    gain = torch.exp(TINT_SIGMA * normal(frames, 1, 1, 1, 3))
    noise = NOISE_GREY * uniform(frames, 1, 1, 1, 1) ** 2 * normal(*seen.shape)
    return torch.clamp(seen * gain + noise, 0, 255), labels, looked


def _choose_strips(vehicles: Tensor, lots: Tensor) -> Tensor:
    """Indices (n, STRIPS_PER_FRAME) of the strips of an epoch: those near vehicles first, then by ``lots``."""
    ahead_m = torch.where(vehicles[:, :, AHEAD] > 0.1, vehicles[:, :, AHEAD], torch.inf)
    strip_m = torch.from_numpy(DISTANCES_M).to(ahead_m)
    steps = (ahead_m[:, :, None] / strip_m).log().abs().amin(dim=1) / math.log(RATIO)
    return (lots - 0.6 * (steps < NEAR_STEPS)).argsort(dim=1)[:, :STRIPS_PER_FRAME]
