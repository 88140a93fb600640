"""Confidence of an estimate from a time series with correlated errors.

The estimate θ minimises Σ ρ(e_i(θ)) + ½·|P(θ)|² with residuals e of unit scale and rows P of prior knowledge. Its
covariance is the sandwich

    H⁻¹·(S + PᵀP)·H⁻¹      H = Σ ψ'(e_i)·J_iᵀJ_i + PᵀP      S = Σ_|k|<m (1 - |k|/m)·Σ_i g_i g_{i+k}ᵀ

with J = ∂e/∂θ, ψ = ρ', scores g_i = ψ(e_i)·J_i (here P stands for its own Jacobian). S is the long-run covariance
of the scores with Bartlett's kernel: Newey and West, Econometrica 55 (1987). Its width m follows from the data by
first-order autoregressions: Andrews, Econometrica 59 (1991), equations 6.2 and 6.4.
"""

import numpy as np

from trepid.types import Array

NORMAL_95 = 1.959964


def soft_l1(error: Array) -> tuple[Array, Array]:
    """ψ and ψ' of ρ(e) = √(1 + e²) - 1: quadratic near zero, linear far away."""
    root = np.sqrt(1.0 + error**2)
    return error / root, root**-3


def covariance(jacobian: Array, error: Array, prior: Array) -> Array:
    """Covariance of the estimate, shape (p, p).

    ``jacobian`` (n, p) and ``error`` (n,) are in order of time, with zeros for samples that are left out; ``prior``
    (q, p) is the Jacobian of the prior rows. Raises LinAlgError when a parameter has no effect at all.
    """
    psi, slope = soft_l1(error)
    known = prior.T @ prior
    bread = np.linalg.inv(jacobian.T @ (slope[:, None] * jacobian) + known)
    return np.asarray(bread @ (long_run(psi[:, None] * jacobian) + known) @ bread)


def long_run(scores: Array) -> Array:
    """Σ_k w_k·Σ_i g_i g_{i+k}ᵀ of ``scores`` (n, p)."""
    width = bandwidth(scores)
    total = scores.T @ scores
    for lag in range(1, int(np.ceil(width))):
        product = scores[:-lag].T @ scores[lag:]
        total += (1.0 - lag / width) * (product + product.T)
    return np.asarray(total)


def bandwidth(scores: Array) -> float:
    """Andrews' m for Bartlett's kernel, of the columns scaled alike; at most a third of the series."""
    before, after = scores[:-1], scores[1:]
    power = np.maximum((before**2).sum(axis=0), 1e-300)
    memory = np.clip((before * after).sum(axis=0) / power, -0.97, 0.97)
    curvature = np.mean(4.0 * memory**2 / ((1.0 - memory) ** 2 * (1.0 + memory) ** 2))
    return float(min(1.1447 * (curvature * len(scores)) ** (1 / 3) + 1.0, len(scores) / 3))
