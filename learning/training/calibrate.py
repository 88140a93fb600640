"""The error scale of a trained network, from the validation frames."""

import math

import numpy as np

from learning.judging.scores import speed_errors
from learning.models.parts.heads import Head
from learning.models.parts.network import SteeringNetwork
from learning.training.frames import Frames
from learning.training.loop import predict
from trepid.types import Floats

COVERAGE = 0.9
BLOCKS = 10  # of the validation frames
LEVELS = 101
LEAST_SIGMA = 1e-4  # of the unit of a network


def set_sigma(network: SteeringNetwork, validation: Frames) -> None:
    """Give a network without an error scale the root mean square error of the validation frames."""
    if type(network.head) is not Head:
        return
    angles, _ = predict(network, validation)
    rms_rad = float(np.sqrt(np.mean((angles - validation.labels_rad) ** 2)))
    network.head.sigma.fill_(max(rms_rad / float(network.scale_rad), LEAST_SIGMA))


def interval(network: SteeringNetwork, validation: Frames, coverage: float = COVERAGE) -> float:
    """q with |error| ≤ q·σ in ``coverage`` of new frames like those of ``validation``.

    Conformal prediction for a record in time (Vovk, Cross-conformal predictors, 2015; here the folds are blocks of
    time). Successive errors are alike: a new stretch differs from the known ones more than a new frame differs from
    its neighbours. The level of the quantile of |error|/σ is raised until the quantile of all other blocks covers
    ``coverage`` of BLOCKS blocks on average. The best epoch is chosen on the same frames.
    """
    angles, sigmas = predict(network, validation)
    return block_quantile(np.abs(angles - validation.labels_rad) / sigmas, coverage)


def block_quantile(ratios: Floats, coverage: float) -> float:
    """The quantile of ``ratios`` (n,), in the order of time, that covers ``coverage`` of a block left out.

    The greatest one where no quantile does, as with fewer than two ratios; LEAST_SIGMA where it is zero, as with
    labels and bins of angles that are equal.
    """
    return max(_block_quantile(ratios, coverage), LEAST_SIGMA)


def _block_quantile(ratios: Floats, coverage: float) -> float:
    blocks = np.array_split(ratios, BLOCKS)
    pairs = [
        (block, np.sort(np.concatenate(blocks[:n] + blocks[n + 1 :])))
        for n, block in enumerate(blocks)
        if 0 < len(block) < len(ratios)
    ]
    for level in np.linspace(coverage, 1.0, LEVELS):
        if pairs and np.mean([(block <= _quantile(rest, level)).mean() for block, rest in pairs]) >= coverage:
            return _quantile(np.sort(ratios), level)
    return float(ratios.max())


def _quantile(ratios: Floats, level: float) -> float:
    """The ⌈(n + 1)·level⌉-th smallest of sorted ``ratios`` (Lei et al., JASA 2018), at most the greatest."""
    return float(ratios[min(math.ceil((len(ratios) + 1) * level), len(ratios)) - 1])


def speed_scores(speeds_mps: Floats, train: Frames, validation: Frames) -> dict[str, float]:
    """Errors of the proposed ``speeds_mps`` (n,) of the validation frames; {} where none of these has a speed."""
    if train.speeds_mps is None or validation.speeds_mps is None:
        return {}
    found = speed_errors(speeds_mps, validation.speeds_mps, train.speeds_mps) or {}
    return {f"speed_{name}": round(value, 4) for name, value in found.items()}


def error_scores(angles_rad: Floats, labels_rad: Floats) -> dict[str, float]:
    """Errors of ``angles_rad`` (n,), and those of the constants 0 and mean label."""
    error_deg = np.degrees(angles_rad - labels_rad)
    labels_deg = np.degrees(labels_rad)
    spread = float(np.mean((labels_deg - labels_deg.mean()) ** 2))
    found = dict(
        frames=float(len(labels_rad)),
        mae_deg=float(np.abs(error_deg).mean()),
        rmse_deg=float(np.sqrt(np.mean(error_deg**2))),
        mean_error_deg=float(error_deg.mean()),
        always_straight_mae_deg=float(np.abs(labels_deg).mean()),
        mean_angle_mae_deg=float(np.abs(labels_deg - labels_deg.mean()).mean()),
    )
    if spread > 0:
        found["r2"] = 1 - float(np.mean(error_deg**2)) / spread
    return {name: round(value, 4) for name, value in found.items()}
