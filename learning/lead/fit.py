"""Fit of the lead network to labelled strips. Needs torch (extra ``[train]``)."""

import math
import time
from collections.abc import Callable, Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.descent import descend, warm_up_cosine
from learning.lead.network import LeadNetwork, Targets, loss
from perception.lead.view import DISTANCES_M, RATIO, STRIPS, Strips

LEARNING_RATE, WEIGHT_DECAY, WARM_UP = 4e-3, 1e-4, 0.05
BATCH = 24
TINT_SIGMA, NOISE_GREY = 0.15, 6.0
AHEAD, LEFT = 0, 1  # columns of the label
STRIPS_PER_FRAME = 8  # used in an epoch: those with vehicles and some others
NEAR_STEPS = 2.5


def fit(
    strips: Strips, vehicles: NDArray[np.float32], *, epochs: int, seed: int, report: Callable[[str], None]
) -> LeadNetwork:
    """A network fitted to frames (n, STRIPS, ROWS, COLUMNS, 3) and their vehicles (n, m, LABEL).

    AdamW (Loshchilov and Hutter, ICLR 2019) with one cosine to zero. Order and augmentation come from ``seed``.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, targets = LeadNetwork(), Targets()
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    steps = math.ceil(len(strips) / BATCH)
    started_s = time.monotonic()
    for epoch in range(epochs):
        losses = []
        for step, (images, labels, looked) in enumerate(_batches(strips, vehicles, seed=seed, epoch=epoch)):
            rate = LEARNING_RATE * warm_up_cosine((epoch + step / steps) / epochs, warm_up=WARM_UP)
            raw = network(images.flatten(0, 1)).unflatten(0, images.shape[:2])
            row = torch.arange(len(looked))[:, None]
            value = loss(raw, *(wanted[row, looked] for wanted in targets(labels)))
            losses.append(descend(network, optimiser, value, rate=rate))
        left_s = (time.monotonic() - started_s) * (epochs - epoch - 1) / (epoch + 1)
        report(f"epoch {epoch + 1}/{epochs}  loss {np.mean(losses):.3f}  {left_s / 60:.1f} min left")
    return network.eval()


def _batches(
    strips: Strips, vehicles: NDArray[np.float32], *, seed: int, epoch: int
) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """All frames in random order, some strips of each; half of them mirrored, all of them tinted and noisy."""
    rng = np.random.default_rng((seed, epoch))
    order = rng.permutation(len(strips))
    for start in range(0, len(order), BATCH):
        chosen = order[start : start + BATCH]
        labels = vehicles[chosen].copy()
        looked = _looked(labels, rng)
        images = strips[chosen[:, None], looked]
        flipped = rng.random(len(chosen)) < 0.5
        images[flipped] = images[flipped][:, :, :, ::-1]
        labels[flipped, :, LEFT] *= -1
        gain = np.exp(rng.normal(0, TINT_SIGMA, (len(chosen), 1, 1, 1, 3))).astype(np.float32)
        noisy = images * gain + rng.standard_normal(images.shape, np.float32) * (
            NOISE_GREY * rng.random((len(chosen), 1, 1, 1, 1), np.float32) ** 2
        )
        yield torch.from_numpy(np.clip(noisy, 0, 255)), torch.from_numpy(labels), torch.from_numpy(looked)


def _looked(vehicles: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices (n, STRIPS_PER_FRAME) of the strips of an epoch: those near vehicles first, then random ones."""
    ahead_m = np.where(vehicles[:, :, AHEAD] > 0.1, vehicles[:, :, AHEAD], np.inf)
    steps = np.abs(np.log(ahead_m[:, :, None] / DISTANCES_M)).min(axis=1) / math.log(RATIO)
    rank = rng.random((len(vehicles), STRIPS)) - 0.6 * (steps < NEAR_STEPS)
    return np.argsort(rank, axis=1)[:, :STRIPS_PER_FRAME]
