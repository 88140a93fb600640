"""The error scale of a trained network, from the validation frames."""

import math

import numpy as np

from learning.models.parts.heads import Head
from learning.models.parts.network import SteeringNetwork
from learning.training.frames import Frames
from learning.training.loop import predict

COVERAGE = 0.9
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

    Split conformal prediction: the ⌈(n + 1)·coverage⌉-th smallest |error|/σ (Lei et al., Distribution-Free
    Predictive Inference for Regression, JASA 2018). Frames that follow each other are alike and the best epoch is
    chosen on the same frames, so that the coverage of another drive can be less.
    """
    angles, sigmas = predict(network, validation)
    scores = np.sort(np.abs(angles - validation.labels_rad) / sigmas)
    return float(scores[min(math.ceil((len(scores) + 1) * coverage), len(scores)) - 1])


def scores(network: SteeringNetwork, validation: Frames) -> dict[str, float]:
    """Errors on the validation frames, and those of the constants 0 and mean label."""
    angles, _ = predict(network, validation)
    error_deg = np.degrees(angles - validation.labels_rad)
    labels_deg = np.degrees(validation.labels_rad)
    spread = float(np.mean((labels_deg - labels_deg.mean()) ** 2))
    found = dict(
        frames=float(len(validation)),
        mae_deg=float(np.abs(error_deg).mean()),
        rmse_deg=float(np.sqrt(np.mean(error_deg**2))),
        mean_error_deg=float(error_deg.mean()),
        always_straight_mae_deg=float(np.abs(labels_deg).mean()),
        mean_angle_mae_deg=float(np.abs(labels_deg - labels_deg.mean()).mean()),
    )
    if spread > 0:
        found["r2"] = 1 - float(np.mean(error_deg**2)) / spread
    return {name: round(value, 4) for name, value in found.items()}
