"""Batches of an epoch. Their order and changes depend on (seed, epoch, step) alone: any step can be redone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.training.frames import Frames
from trepid.types import Floats, Image

Augment = Callable[[Image, Floats, np.random.Generator], tuple[Image, Floats]]
"""Frames (t, H, W, 3) of a sequence and their labels (t,) [rad] -> changed ones."""
ORDER, CHANGE, DROPOUT = 0, 1, 2  # streams of random numbers


class Batch(NamedTuple):
    """Frames (n, H, W, 3), or (n, t, H, W, 3) of a recurrent network; the others are (n,) or (n, t)."""

    images: Tensor
    labels_rad: Tensor
    weights: Tensor
    speeds_mps: Tensor  # of the driver, of the shape of the labels; NaN: not recorded


@dataclass(frozen=True, slots=True)
class Batches:
    """The batches of a training: ``places`` (m, t) of the frames of each sequence; t = 1 without a memory."""

    frames: Frames
    places: NDArray[np.int64]
    weights: Floats  # (n,) of the frames
    size: int
    seed: int
    augment: Augment
    recurrent: bool

    def __len__(self) -> int:
        """Batches of an epoch; a single sequence that is left over goes into the batch before.

        Batch normalisation has no variance of one row.
        """
        whole, left = divmod(len(self.places), self.size)
        return max(1, whole + (left > 1))

    def epoch(self, epoch: int, first: int = 0) -> Iterator[Batch]:
        """The batches of ``epoch`` from step ``first`` on."""
        order = np.random.default_rng((self.seed, ORDER, epoch)).permutation(len(self.places))
        for step in range(first, len(self)):
            rng = np.random.default_rng((self.seed, CHANGE, epoch, step))
            end = (step + 1) * self.size if step + 1 < len(self) else None
            chosen = self.places[order[step * self.size : end]]
            parts = [self.augment(self.frames.images[at], self.frames.labels_rad[at], rng) for at in chosen]
            images, labels = (np.stack(column) for column in zip(*parts, strict=True))
            columns = [images, labels, self.weights[chosen], self._speeds_mps(chosen)]
            yield Batch(*(torch.from_numpy(one if self.recurrent else one[:, 0]) for one in columns))

    def _speeds_mps(self, chosen: NDArray[np.int64]) -> Floats:
        known = self.frames.speeds_mps
        return np.full(chosen.shape, np.nan, np.float32) if known is None else known[chosen]


def seed_step(seed: int, epoch: int, step: int) -> None:
    """Seed torch for one step: dropout depends on (seed, epoch, step) alone."""
    state = np.random.SeedSequence((seed, DROPOUT, epoch, step)).generate_state(1, np.uint64)
    torch.manual_seed(int(state[0] >> np.uint64(1)))
