"""Optimisers by name, and averaged weights."""

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from learning.training.recipe import Recipe, Stage

RMSPROP_DECAY = 0.9  # Keras
KERAS_EPSILON = 1e-7


def optimiser(recipe: Recipe, stage: Stage, weights: Iterable[nn.Parameter]) -> torch.optim.Optimizer:
    """The optimiser of a stage; decay of weights is decoupled in adamw alone."""
    rate, decay = stage.learning_rate, recipe.weight_decay
    if recipe.optimiser == "adamw":
        return torch.optim.AdamW(weights, lr=rate, weight_decay=decay)
    if recipe.optimiser == "adam":
        return torch.optim.Adam(weights, lr=rate, weight_decay=decay, eps=KERAS_EPSILON)
    if recipe.optimiser == "rmsprop":
        return torch.optim.RMSprop(
            weights, lr=rate, alpha=RMSPROP_DECAY, weight_decay=decay, eps=KERAS_EPSILON
        )
    nesterov = recipe.optimiser == "nag"
    return torch.optim.SGD(weights, lr=rate, momentum=recipe.momentum, weight_decay=decay, nesterov=nesterov)


def averaged(network: nn.Module, decay: float) -> AveragedModel | None:
    """Exponential mean of weights and statistics; None where ``decay`` is 0.

    The decay of step n is min(decay, (1 + n)/(10 + n)): the first weights are soon forgotten.
    """
    if decay == 0:
        return None

    def mean(old: Tensor, new: Tensor, steps: Tensor) -> Tensor:
        kept = min(decay, (1 + int(steps)) / (10 + int(steps)))
        return old + (new - old) * (1 - kept) if old.is_floating_point() else new

    return AveragedModel(network, avg_fn=mean, use_buffers=True)
