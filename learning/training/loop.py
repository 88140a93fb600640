"""The training loop: stages, checkpoints, early stopping on the mean absolute error of the validation frames.

Plain torch. A killed training continues from its checkpoint with the same batches and the same random numbers, so
that its weights equal those of an undisturbed one bit by bit, for the same number of threads on the same machine.

Optimisers are chosen by name; weights may be averaged.
"""

import copy
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from learning.descent import ahead, descend, warm_up_cosine
from learning.models.parts.network import SteeringNetwork
from learning.training.batches import Batch, Batches, seed_step
from learning.training.checkpoint import Checkpoints
from learning.training.frames import Frames
from learning.training.recipe import Recipe, Stage
from trepid.config import InputError
from trepid.types import Floats

KERAS_EPSILON = 1e-7
OPTIMISERS: Mapping[str, tuple[type[torch.optim.Optimizer], dict[str, Any]]] = MappingProxyType(
    {
        "sgd": (torch.optim.SGD, {}),
        "nag": (torch.optim.SGD, {"nesterov": True}),
        "adagrad": (torch.optim.Adagrad, {"eps": KERAS_EPSILON, "initial_accumulator_value": 0.1}),
        "adadelta": (torch.optim.Adadelta, {"eps": KERAS_EPSILON, "rho": 0.95}),
        "rmsprop": (torch.optim.RMSprop, {"eps": KERAS_EPSILON, "alpha": 0.9}),
        "adam": (torch.optim.Adam, {"eps": KERAS_EPSILON}),
        "nadam": (torch.optim.NAdam, {"eps": KERAS_EPSILON}),
        "adamw": (torch.optim.AdamW, {}),
    }
)
"""Name in a recipe -> its class and its options, which are those of Keras."""
WITH_MOMENTUM = ("sgd", "nag")


def optimiser(recipe: Recipe, stage: Stage, weights: Iterable[nn.Parameter]) -> torch.optim.Optimizer:
    """The optimiser of a stage; decay of weights is decoupled in adamw alone."""
    kind, options = OPTIMISERS[recipe.optimiser]
    if recipe.optimiser in WITH_MOMENTUM:
        options = {**options, "momentum": recipe.momentum}
    return kind(weights, lr=stage.learning_rate, weight_decay=recipe.weight_decay, **options)


def averaged_model(network: nn.Module, decay: float) -> AveragedModel | None:
    """Exponential mean of weights and statistics; None where ``decay`` is 0.

    The decay of step n is min(decay, (1 + n)/(10 + n)): the first weights are soon forgotten.
    """
    if decay == 0:
        return None

    def mean(old: Tensor, new: Tensor, steps: Tensor) -> Tensor:
        kept = min(decay, (1 + int(steps)) / (10 + int(steps)))
        return old + (new - old) * (1 - kept) if old.is_floating_point() else new

    return AveragedModel(network, avg_fn=mean, use_buffers=True)


EVALUATION_BATCH = 128


class Divergence(InputError):
    """The loss or an angle of a network in training is not finite."""


@dataclass(slots=True)
class Progress:
    """Where a training stands: the content of a checkpoint besides weights and optimiser."""

    stage: int = 0
    epoch: int = 0  # finished ones, of all stages
    stage_epoch: int = 0
    step: int = 0  # finished ones of the epoch under way
    loss_sum: float = 0.0
    best_epoch: int = 0
    best_mae_rad: float = math.inf
    stage_best_epoch: int = 0
    stage_best_mae_rad: float = math.inf
    elapsed_s: float = 0.0
    curve: list[dict[str, float]] = field(default_factory=list)
    finished: bool = False


@dataclass(slots=True)
class Trainer:
    """One training; :meth:`run` does it, from the last checkpoint on."""

    recipe: Recipe
    network: SteeringNetwork
    batches: Batches
    validation: Frames
    checkpoints: Checkpoints
    identity: str  # of network, recipe and data: a checkpoint of another is refused
    report: Callable[[str], None]
    on_epoch: Callable[[Progress], None]
    progress: Progress = field(default_factory=Progress)
    best: dict[str, Tensor] | None = None

    def run(self, *, resume: bool) -> Progress:
        """Train; the network ends with the weights of the best epoch, 0 for those of :meth:`keep_first`.

        Raises Divergence, and InputError for damaged checkpoints or those of another training.
        """
        torch.set_num_threads(self.recipe.threads)
        saved = self.checkpoints.of(self.identity, self.report) if resume else None
        if saved is not None:
            self._restore(saved)
        while not self.progress.finished:
            self._stage(self.recipe.stages[self.progress.stage], saved)
            saved = None
        if self.best is not None:
            self.network.load_state_dict(self.best)
        self.network.eval()
        return self.progress

    def keep_first(self) -> None:
        """Let the weights before the first epoch be those of epoch 0, which later ones must improve on."""
        self.progress.best_mae_rad = mean_error_rad(self.network, self.validation)
        self.best = copy.deepcopy(self.network.state_dict())

    def _stage(self, stage: Stage, saved: dict[str, Any] | None) -> None:
        progress = self.progress
        for parameter in self.network.trunk.parameters():
            parameter.requires_grad = stage.part == "all"
        weights = [p for p in self.network.parameters() if p.requires_grad]
        steps = optimiser(self.recipe, stage, weights)
        mean = averaged_model(self.network, self.recipe.average)
        if saved is not None:
            steps.load_state_dict(saved["optimiser"])
            if mean is not None:
                mean.load_state_dict(saved["mean"])
        while (
            progress.stage_epoch < stage.epochs
            and progress.stage_epoch - progress.stage_best_epoch < stage.patience
        ):
            self._epoch(stage, steps, mean)
        last = progress.stage + 1 == len(self.recipe.stages)
        if self.best is not None:
            self.network.load_state_dict(self.best)  # the next stage begins with the best weights
        progress.stage += 0 if last else 1
        progress.stage_epoch, progress.stage_best_epoch, progress.stage_best_mae_rad = 0, 0, math.inf
        progress.finished = last
        if last:
            self._save(steps, mean)

    def _epoch(self, stage: Stage, steps: torch.optim.Optimizer, mean: AveragedModel | None) -> None:
        progress = self.progress
        started_s = saved_s = time.monotonic()
        self.network.train()
        if stage.part == "top":
            self.network.trunk.eval()  # keeps the statistics of batch normalisation too
        for batch in ahead(self.batches.epoch(progress.epoch, progress.step)):
            done = (progress.stage_epoch + progress.step / len(self.batches)) / stage.epochs
            factor = warm_up_cosine(done, warm_up=self.recipe.warm_up) if stage.schedule == "cosine" else 1.0
            seed_step(self.recipe.seed, progress.epoch, progress.step)
            value = self._loss(batch)
            if not math.isfinite(value.item()):
                raise Divergence(
                    f"the loss is not finite in step {progress.step + 1} of epoch {progress.epoch + 1}: "
                    f"lower the learning rate of the stage {stage.name!r}, now {stage.learning_rate:g}"
                )
            progress.loss_sum += descend(self.network, steps, value, rate=stage.learning_rate * factor)
            if mean is not None:
                mean.update_parameters(self.network)
            progress.step += 1
            now_s = time.monotonic()
            if now_s - saved_s >= self.recipe.checkpoint_s > 0 and progress.step < len(self.batches):
                progress.elapsed_s += now_s - started_s
                started_s = saved_s = now_s
                self._save(steps, mean)
                self.report(
                    f"{stage.name}: step {progress.step}/{len(self.batches)} of epoch {progress.epoch + 1}"
                )
        progress.elapsed_s += time.monotonic() - started_s
        self._finish_epoch(stage, steps, mean)

    def _finish_epoch(self, stage: Stage, steps: torch.optim.Optimizer, mean: AveragedModel | None) -> None:
        progress, started_s = self.progress, time.monotonic()
        judged = self.network if mean is None else mean.module
        assert isinstance(judged, SteeringNetwork)
        mae_rad = mean_error_rad(judged, self.validation)
        if not math.isfinite(mae_rad):
            raise Divergence(
                f"the network gives no finite angle after epoch {progress.epoch + 1}: lower the learning rate"
            )
        loss = progress.loss_sum / len(self.batches)
        progress.epoch, progress.stage_epoch = progress.epoch + 1, progress.stage_epoch + 1
        progress.step, progress.loss_sum = 0, 0.0
        if mae_rad < progress.stage_best_mae_rad:
            progress.stage_best_mae_rad, progress.stage_best_epoch = mae_rad, progress.stage_epoch
        if mae_rad < progress.best_mae_rad:
            progress.best_mae_rad, progress.best_epoch = mae_rad, progress.epoch
            self.best = copy.deepcopy(judged.state_dict())
        progress.elapsed_s += time.monotonic() - started_s
        progress.curve.append(
            dict(
                epoch=progress.epoch,
                stage=progress.stage,
                loss=loss,
                validation_mae_rad=mae_rad,
                elapsed_s=progress.elapsed_s,
            )
        )
        self._save(steps, mean)
        self.on_epoch(progress)
        self.report(_status(self.recipe, stage, progress, loss, mae_rad))

    def _loss(self, batch: Batch) -> Tensor:
        device = self.network.scale_rad.device
        images, labels_rad, weights, speeds_mps = (one.to(device) for one in batch)
        with torch.autocast(device.type, torch.bfloat16, enabled=uses_mixed_precision(self.recipe, device)):
            raw = self.network(images).float()
        if self.network.memory is not None:  # perhaps rows of the last frame alone
            labels_rad, weights, speeds_mps = (
                one[:, -raw.shape[1] :] for one in (labels_rad, weights, speeds_mps)
            )
        rows = self.network.head.losses(
            self.network.steering(raw),
            labels_rad / self.network.scale_rad,
            loss=self.recipe.loss,
            beta=self.recipe.beta,
        )
        loss = (rows * weights).mean()
        if self.network.speed is not None:
            loss = loss + self.recipe.speed_weight * self.network.speed.loss(raw, speeds_mps)
        return loss

    def _save(self, steps: torch.optim.Optimizer, mean: nn.Module | None) -> None:
        self.checkpoints.save(
            dict(
                identity=self.identity,
                network=self.network.state_dict(),
                mean=None if mean is None else mean.state_dict(),
                optimiser=steps.state_dict(),
                best=self.best,
                progress=asdict(self.progress),
            )
        )

    def _restore(self, saved: dict[str, Any]) -> None:
        self.network.load_state_dict(saved["network"])
        self.best, self.progress = saved["best"], Progress(**saved["progress"])


def uses_mixed_precision(recipe: Recipe, device: torch.device) -> bool:
    """Whether layers compute in bfloat16."""
    return recipe.mixed_precision == "always" or (recipe.mixed_precision == "gpu" and device.type == "cuda")


def predict(network: SteeringNetwork, frames: Frames) -> tuple[Floats, Floats]:
    """Road-wheel angles and deviations [rad], (n,) each, of all frames; a memory begins anew in every stretch."""
    network.eval()
    with torch.no_grad():
        rows = [network.angle(raw) for raw in _rows(network, frames)]
    angles, sigmas = (
        np.concatenate([one.cpu().numpy() for one in column]) for column in zip(*rows, strict=True)
    )
    return angles.astype(np.float32), sigmas.astype(np.float32)


def predict_speeds(network: SteeringNetwork, frames: Frames) -> Floats:
    """The speeds (n,) [m/s] that a network with such an output proposes for all frames."""
    assert network.speed is not None
    network.eval()
    with torch.no_grad():
        found = [network.speed.speed_mps(raw).cpu().numpy() for raw in _rows(network, frames)]
    return np.concatenate(found).astype(np.float32)


def mean_error_rad(network: SteeringNetwork, frames: Frames) -> float:
    """Mean absolute error of the angles of all frames [rad]."""
    angles, _ = predict(network, frames)
    return float(np.abs(angles - frames.labels_rad).mean())


def _rows(network: SteeringNetwork, frames: Frames) -> list[Tensor]:
    device = network.scale_rad.device
    memory, rows = network.memory, []
    states: deque[Tensor] = deque()
    for start in range(0, len(frames), EVALUATION_BATCH):
        part = slice(start, start + EVALUATION_BATCH)
        features = network.before_memory(torch.from_numpy(frames.images[part].copy()).to(device))
        if memory is not None:
            outputs = []
            for place, feature in enumerate(features, start=start):
                if not place or frames.stretches[place] != frames.stretches[place - 1]:
                    states = deque([torch.zeros(1, memory.state_size, device=device)] * network.stride)
                output, state = memory.step(feature[None], states.popleft())
                states.append(state)
                outputs.append(output)
            features = torch.cat(outputs)
        rows.append(network.after_memory(features).float())
    return rows


def _status(recipe: Recipe, stage: Stage, progress: Progress, loss: float, mae_rad: float) -> str:
    left = stage.epochs - progress.stage_epoch + sum(s.epochs for s in recipe.stages[progress.stage + 1 :])
    left_s = left * progress.elapsed_s / progress.epoch
    best = " best" if progress.best_epoch == progress.epoch else ""
    return (
        f"{stage.name}: epoch {progress.stage_epoch}/{stage.epochs}  loss {loss:.4f}"
        f"  validation error {math.degrees(mae_rad):.3f}°{best}  at most {left_s / 60:.1f} min left"
    )
