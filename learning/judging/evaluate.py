"""The judgement of one model on one split of a data set, as the row of ``trepid evaluate --json``.

Beside its errors stand those of predictions without an image (straight ahead, the mean of the training, the angle
of a moment ago), and the errors that it states: coverage of intervals, order of errors, confidence, world.
"""

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from learning.dataset.dataset import Dataset
from learning.judging import scores
from learning.judging.baselines import Baselines
from learning.judging.predictions import JudgedModel, Predictions
from learning.judging.scores import Angles, block_frames, intervals
from perception.net.driver import TOLERANCE_RAD

COVERAGES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
LEAST_FRAMES = 20  # for statements about the order of errors


def coverage(error_deg: Angles, half_width_deg: Angles) -> dict[str, float]:
    """Share of the frames with |error| within the interval, and the mean width of the intervals."""
    return {
        "coverage_90": float((np.abs(error_deg) <= half_width_deg).mean()),
        "mean_width_deg": float(2 * half_width_deg.mean()),
    }


def risk_coverage(error_deg: Angles, sigma_deg: Angles) -> dict[str, object] | None:
    """MAE of the frames with the smallest sigma, by their share; None with fewer than LEAST_FRAMES.

    ``aurc_deg`` is the mean of the MAE over all shares k/n (area under the risk-coverage curve; Geifman and
    El-Yaniv, Selective Classification for Deep Neural Networks, 2017), ``oracle_aurc_deg`` that of the true order
    of errors, and ``spearman`` the rank correlation of sigma and |error|.
    """
    n, size = len(error_deg), np.abs(error_deg)
    if n < LEAST_FRAMES:
        return None
    risks = np.cumsum(size[np.argsort(sigma_deg, kind="stable")]) / np.arange(1, n + 1)
    best = np.cumsum(np.sort(size)) / np.arange(1, n + 1)
    varies = np.ptp(sigma_deg) > 0 and np.ptp(size) > 0
    return {
        "mae_deg_at": {f"{share:g}": float(risks[max(1, round(share * n)) - 1]) for share in COVERAGES},
        "aurc_deg": float(risks.mean()),
        "oracle_aurc_deg": float(best.mean()),
        "spearman": float(spearmanr(sigma_deg, size).statistic) if varies else None,
    }


def calibration(error_rad: Angles, confidence: Angles, tolerance_rad: float) -> dict[str, float]:
    """Mean confidence beside the share of errors below the tolerance, of which it is the probability."""
    return {
        "mean_confidence": float(confidence.mean()),
        "within_tolerance": float((np.abs(error_rad) < tolerance_rad).mean()),
    }


def world(error_deg: Angles, unlike: Angles) -> dict[str, float | None]:
    """Share of the frames outside the world of the model, and the MAE inside and outside."""
    outside, size = unlike > 1.0, np.abs(error_deg)
    return {
        "outside": float(outside.mean()),
        "mae_inside_deg": float(size[~outside].mean()) if not outside.all() else None,
        "mae_outside_deg": float(size[outside].mean()) if outside.any() else None,
    }


BIN_RATIO = 16.0  # steering-wheel angle / road-wheel angle of the bins, as of a passenger car
LIGHTS = {"dark": 0.0, "dim": 0.2, "day": 0.4, "bright": 0.65}
"""Name of a group of frames -> its least mean grey."""
WORST, APART_S = 20, 1.0  # frames that are listed, and the least time between two of one stretch


class Bench:
    """The split to judge models on: its recorded angles, and the angles of the baselines.

    Degrees are of the road wheel, or with ``ratio`` of a steering wheel that turns ``ratio`` times as far. Bins are
    those of a steering wheel with ``ratio``, or without it BIN_RATIO.
    """

    def __init__(
        self, dataset: Dataset, split: str, *, ratio: float | None = None, trained: Dataset | None = None
    ) -> None:
        """``trained``: the data set whose training frames have the angle of the baseline "mean", if it is another.

        Raises InputError for an unknown split and for one without labelled frames.
        """
        self.dataset = dataset
        self._without_image = Baselines(dataset, split, trained=trained)
        self.rows = self._without_image.rows
        self.unit_deg = math.degrees(ratio or 1.0)  # output degrees per radian of the road wheel
        self.wheel = "steering wheel" if ratio else "road wheel"  # whose degrees they are
        self._wheel_ratio = 1.0 if ratio else BIN_RATIO  # degrees of the steering wheel per output degree
        self.true_deg: Angles = self.rows["road_wheel_rad"] * self.unit_deg
        self._lights = light_names(self.rows["light"])
        self.baselines = self._without_image.scores(self.unit_deg)
        self._learned_mps: Angles = (trained or dataset).rows("train")["speed_mps"]

    def row(self, model: JudgedModel, found: Predictions) -> dict[str, Any]:
        """The scores of ``model``; those of an estimator on the frames with an answer."""
        seen, network = found.has_angle, model.network
        predicted, true = found.angle_rad[seen] * self.unit_deg, self.true_deg[seen]
        rows, ratio = self.rows[seen], self._wheel_ratio
        row: dict[str, Any] = {"model": model.name, "file": model.text}
        if network is not None:
            record = network.record
            row |= {"family": record.model, "parameters": record.parameters}
            row |= {"size": [record.width, record.height]}
            row |= {"same_data": record.data_sha256 == self.dataset.sha256}
        row |= scores.errors(predicted, true)
        row |= {
            "answered": float(seen.mean()),
            "intervals_95": intervals(predicted, true, block=block_frames(rows["t_s"])) if seen.any() else {},
            "latency_ms": float(np.median(found.latency_ms)),
            "latency_p99_ms": float(np.percentile(found.latency_ms, 99)),
            "baselines": self.baselines,
            "speed": scores.speed_errors(found.speed_mps, self.rows["speed_mps"], self._learned_mps),
        }
        learning = self._without_image.learning(found.angle_rad, unit_deg=self.unit_deg)
        row |= {"findings": [asdict(one) for one in learning.findings], "conclusion": learning.conclusion}
        if not seen.any():
            return row
        rate = (rows["t_s"], rows["stretch"])
        edges = scores.bin_edges_deg(true, ratio)
        return row | {
            "bins": scores.by_size(predicted, true, edges, ratio),
            "sharpness": scores.by_size(predicted, true, (0.0, scores.SHARP_DEG, math.inf), ratio),
            "straight_bias_deg": scores.straight_bias_deg(predicted, true, ratio),
            "rate_rms_degps": scores.rate_rms_degps(predicted, *rate),
            "recorded_rate_rms_degps": scores.rate_rms_degps(true, *rate),
            "rate_error_rms_degps": scores.rate_rms_degps(predicted - true, *rate),
            "routes": scores.groups(predicted, true, rows["route"]),
            "light": scores.groups(predicted, true, self._lights[seen]),
            "uncertainty": self._uncertainty(found, predicted - true),
            "worst": self._worst(found),
        }

    def _uncertainty(self, found: Predictions, error_deg: Angles) -> dict[str, Any]:
        """What the model states about its errors; without intervals only its confidence."""
        seen = found.has_angle
        stated: dict[str, Any] = calibration(error_deg / self.unit_deg, found.confidence[seen], TOLERANCE_RAD)
        width_deg = found.interval_rad[seen] * self.unit_deg
        if not np.isfinite(width_deg).all():
            return stated | {"risk": risk_coverage(error_deg, -found.confidence[seen])}
        stated |= coverage(error_deg, width_deg) | world(error_deg, found.unlike[seen])
        return stated | {"risk": risk_coverage(error_deg, width_deg)}

    def worst(self, found: Predictions, most: int = WORST) -> list[int]:
        """Numbers of the frames with the greatest errors, at least APART_S apart."""
        error = np.abs(found.angle_rad * self.unit_deg - self.true_deg)
        chosen: list[int] = []
        for number in np.argsort(-np.nan_to_num(error, nan=-1.0), kind="stable").tolist():
            if len(chosen) == most or not np.isfinite(error[number]):
                break
            row = self.rows[number]
            others = self.rows[chosen]
            near = (others["stretch"] == row["stretch"]) & (np.abs(others["t_s"] - row["t_s"]) < APART_S)
            if not near.any():
                chosen.append(number)
        return chosen

    def _worst(self, found: Predictions) -> list[dict[str, Any]]:
        return [
            {
                "route": str(self.rows["route"][n]),
                "frame": int(self.rows["frame"][n]),
                "t_s": float(self.rows["t_s"][n]),
                "true_deg": float(self.true_deg[n]),
                "predicted_deg": float(found.angle_rad[n] * self.unit_deg),
            }
            for n in self.worst(found)
        ]


def light_names(grey: Angles) -> NDArray[np.str_]:
    """The group of LIGHTS of each mean grey; "unknown" for NaN."""
    at = np.searchsorted([*LIGHTS.values()], np.nan_to_num(grey), side="right") - 1
    return np.where(np.isfinite(grey), np.array([*LIGHTS])[at], "unknown")
