"""What the trainings share: a step of an optimiser, learning rates, batches ahead. Needs torch."""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import Tensor, nn

GRADIENT_NORM = 5.0
T = TypeVar("T")


def warm_up_cosine(done: float, *, warm_up: float) -> float:
    """Factor of the learning rate at the share ``done`` of all steps: a linear rise, then half a cosine to zero."""
    if done < warm_up:
        return done / warm_up
    return (1 + math.cos(math.pi * (done - warm_up) / (1 - warm_up))) / 2


def descend(network: nn.Module, optimiser: torch.optim.Optimizer, value: Tensor, *, rate: float) -> float:
    """A step of ``optimiser`` at the learning rate ``rate`` down the gradient of the loss ``value``; its number."""
    for group in optimiser.param_groups:
        group["lr"] = rate
    optimiser.zero_grad()
    value.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
    optimiser.step()
    return value.item()


def ahead(batches: Iterator[T]) -> Iterator[T]:
    """The same batches, each prepared in a thread while the former is used."""
    with ThreadPoolExecutor(max_workers=1) as thread:
        pending = thread.submit(next, batches, None)
        while (batch := pending.result()) is not None:
            pending = thread.submit(next, batches, None)
            yield batch
