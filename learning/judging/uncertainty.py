"""Stated errors of a model beside its real ones: coverage of intervals, order of errors, confidence, world."""

import numpy as np
from scipy.stats import spearmanr

from learning.judging.scores import Angles

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
