"""Scores of a lane network on labelled frames: errors, calibration, false positives on images without a road."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from learning.lane.augment import nonsense
from perception.net.steer_net import Calibration, Network
from trepid.types import Array, Floats, Image, Mask

PREDICT_BATCH = 64
MIN_SLOPE = 1e-3  # a larger σ never raises the confidence
ECE_BINS = 10


@dataclass(frozen=True, slots=True)
class LabelledFrames:
    """Canonical images with the lane in them."""

    images: Image  # (n, height, width, 3)
    lanes: Floats  # (n, 5): offset [m], heading [rad], curvature at the axle and ahead [1/m], width [m]
    visible: Mask  # (n,): whether a road is visible

    def __len__(self) -> int:
        return len(self.images)

    def part(self, chosen: Mask) -> "LabelledFrames":
        """The frames where ``chosen``, shape (n,), is true."""
        return LabelledFrames(self.images[chosen], self.lanes[chosen], self.visible[chosen])


@dataclass(frozen=True, slots=True)
class PursuitTask:
    """Use of the lane: pure pursuit by a vehicle."""

    wheelbase_m: float
    command_row: Array  # r with κ_cmd = r·lane, without its width

    def road_wheel_angle(self, lanes: NDArray[np.floating]) -> Array:
        """δ = atan(L·κ_cmd) [rad], shape (n,)."""
        return np.arctan(
            self.wheelbase_m * (lanes[:, : len(self.command_row)].astype(float) @ self.command_row)
        )


@dataclass(frozen=True, slots=True)
class Prediction:
    """Outputs of the network for n frames."""

    lanes: Floats  # (n, 5)
    sigma_rad: Array  # (n,): standard deviation of the road-wheel angle
    visible: Array  # (n,): probability of a road


def predict(network: Network, images: Image, task: PursuitTask) -> Prediction:
    """The network's outputs for all ``images``."""
    lanes, sigmas, visible = outputs(network, images)[:3]
    return Prediction(lanes, task.wheelbase_m * sigmas.astype(float), visible.astype(float))


def outputs(network: Network, images: Image) -> tuple[Floats, ...]:
    """All outputs of the network for ``images``."""
    parts = [network(images[i : i + PREDICT_BATCH]) for i in range(0, len(images), PREDICT_BATCH)]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def calibrate(sigma_rad: Array, error_rad: Array, *, tolerance_rad: float) -> Calibration:
    """Logistic regression of "|error| < tolerance" on ln(tolerance/σ), with Platt's softened targets.

    Platt, Probabilistic Outputs for Support Vector Machines (1999), section 2.2.
    """
    good = np.abs(error_rad) < tolerance_rad
    target = np.where(good, (good.sum() + 1) / (good.sum() + 2), 1 / ((~good).sum() + 2))
    features = np.column_stack([np.ones_like(sigma_rad), np.log(tolerance_rad / sigma_rad)])

    def cross_entropy(weights: Array) -> tuple[float, Array]:
        logit = features @ weights
        probability = 1 / (1 + np.exp(-np.clip(logit, -50, 50)))
        value = np.logaddexp(0, logit) - target * logit
        return float(value.mean()), features.T @ (probability - target) / len(target)

    bounds = [(None, None), (MIN_SLOPE, None)]
    fit = minimize(cross_entropy, [0.0, 1.0], jac=True, method="L-BFGS-B", bounds=bounds)
    return Calibration(tolerance_rad=tolerance_rad, bias=float(fit.x[0]), slope=float(fit.x[1]))


def expected_calibration_error(probability: Array, happened: Mask) -> float:
    """Mean |share that happened − mean probability| over ten bins of equally many (Naeini et al., AAAI 2015)."""
    order = np.argsort(probability, kind="stable")
    bins = [own for own in np.array_split(order, ECE_BINS) if len(own)]
    gaps = [len(own) * abs(happened[own].mean() - probability[own].mean()) for own in bins]
    return float(sum(gaps) / len(probability))


def auroc(score: Array, positive: Mask) -> float:
    """Probability that a positive scores higher than a negative, ties half; 1 when one class is empty."""
    if positive.all() or not positive.any():
        return 1.0
    _, rank, count = np.unique(score, return_inverse=True, return_counts=True)
    mean_rank = (np.cumsum(count) - (count - 1) / 2)[rank]
    positives = int(positive.sum())
    pairs = positives * (len(score) - positives)
    return float((mean_rank[positive].sum() - positives * (positives + 1) / 2) / pairs)


def scores(
    network: Network, data: LabelledFrames, task: PursuitTask, calibration: Calibration, *, scale: float = 1.0
) -> dict[str, float]:
    """Errors on the frames with a visible road: mean absolute errors except where named otherwise.

    ``scale``: of the true world to the canonical one of ``data``, in which the wheelbase is shorter by it.
    """
    data, task = data.part(data.visible), PursuitTask(task.wheelbase_m / scale, task.command_row)
    found = predict(network, data.images, task)
    in_metres = np.array([scale, 1.0, 1 / scale, 1 / scale, scale])
    error = in_metres * np.abs(found.lanes - data.lanes).mean(axis=0)
    wanted_deg, found_deg = (np.rad2deg(task.road_wheel_angle(lanes)) for lanes in (data.lanes, found.lanes))
    angle_deg = np.abs(found_deg - wanted_deg)
    good = angle_deg < np.rad2deg(calibration.tolerance_rad)
    confidence = found.visible * np.array([calibration.probability(sigma) for sigma in found.sigma_rad])
    named = {
        "frames": len(data),
        "offset_m": error[0],
        "heading_deg": np.rad2deg(error[1]),
        "curvature_1pm": error[2],
        "curvature_ahead_1pm": error[3],
        "width_m": error[4],
        "road_wheel_angle_deg": angle_deg.mean(),
        "road_wheel_angle_p95_deg": np.quantile(angle_deg, 0.95),
        "road_wheel_angle_slope": (found_deg * wanted_deg).sum() / max((wanted_deg**2).sum(), 1e-9),
        "within_tolerance": good.mean(),
        "mean_confidence": confidence.mean(),
        "calibration_error": expected_calibration_error(confidence, good),
        "auroc_of_confidence": auroc(confidence, good),
        "seen": (found.visible > 0.5).mean(),
    }
    return {name: round(float(value), 5) for name, value in named.items()}


def nonsense_shares(network: Network, data: LabelledFrames, *, seed: int) -> dict[str, float]:
    """False positives: share of images without a road, and of over-exposed frames, with an estimate."""
    rng = np.random.default_rng((seed, 2))
    images = np.stack([nonsense(image, rng) for image in data.images[data.visible]])
    blind = data.images[~data.visible]

    def share_with_road(frames: Image) -> float:
        return round(float(np.mean(outputs(network, frames)[2] > 0.5)), 5) if len(frames) else 0.0

    counts = {"frames": float(len(images)), "blind_frames": float(len(blind))}
    return counts | {"seen": share_with_road(images), "blind_seen": share_with_road(blind)}
