"""Linear-quadratic gains, and the margins of a loop that predicts over its dead time.

    minimise ∫ xᵀQx + ρ·u² dt    over u = -K·x    where x' = A·x + B·u        (shapes (n, n), (n,), one input)

K = BᵀP/ρ with the stabilising solution P of AᵀP + PA - PBBᵀP/ρ + Q = 0, which the stable eigenvectors (U₁, U₂) of
the Hamiltonian matrix give as P = U₂·U₁⁻¹. Laub, IEEE Trans. Automatic Control 24 (1979); Anderson and Moore,
Optimal Control (1990), section 3.3 and chapter 5 (margins).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trepid.types import Array


def gains(a: Array, b: Array, q: Array, rho: float) -> Array:
    """K, shape (n,). Raises LinAlgError where nothing stabilises ``a``, or ``q`` sees too little of it."""
    n = len(a)
    hamiltonian = np.block([[a, -np.outer(b, b) / rho], [-q, -a.T]])
    values, vectors = np.linalg.eig(hamiltonian)
    stable = vectors[:, values.real < 0.0]
    if stable.shape[1] != n:
        raise np.linalg.LinAlgError("the Hamiltonian has eigenvalues on the imaginary axis")
    p = np.real(np.linalg.solve(stable[:n].T, stable[n:].T).T)
    return np.asarray(b @ p / rho)


class Margins(NamedTuple):
    """How wrong the loop may be at the input of the plant before it is unstable."""

    gain: float  # factor up
    phase_rad: float
    delay_s: float

    @property
    def gain_db(self) -> float:
        """``gain`` in decibels."""
        return 20.0 * math.log10(self.gain) if self.gain < math.inf else math.inf


def loop(a: Array, b: Array, k: Array, dead_s: float, omega_radps: Array) -> NDArray[np.complex128]:
    """L(jω) of x' = A·x + B·u(t - T) under u = -K·x̂(t + T), broken at the input of the plant. Shape of ω.

    The prediction x̂(t + T) = e^(AT)·x + ∫ e^(Aθ)·B·u(t - θ) dθ over the dead time T is exact, so the closed loop
    has the poles of A - B·K. With G = (jω - A)⁻¹B:

        L = K·e^(AT)·G·e^(-jωT) / (1 + K·(G - e^(AT)·G·e^(-jωT)))

    Manitius and Olbrot, IEEE Trans. Automatic Control 24 (1979).
    """
    ahead = exponential(a * dead_s)
    s = 1j * omega_radps
    g = np.linalg.solve(
        s[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b[:, None], (len(s), len(b), 1))
    )
    late = (k @ ahead @ g)[:, 0] * np.exp(-s * dead_s)
    return np.asarray(late / (1.0 + (k @ g)[:, 0] - late))


def margins(response: NDArray[np.complex128], omega_radps: Array) -> Margins:
    """The smallest margins of a loop that is stable when closed, from its L(jω) over rising ω."""
    size, phase = np.abs(response), np.unwrap(np.angle(response))
    gain, phase_rad, delay_s = math.inf, math.pi, math.inf
    for i in np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0):
        share = _share(math.log(size[i]), math.log(size[i + 1]))
        left_rad = math.remainder(float(phase[i] + share * (phase[i + 1] - phase[i])) + math.pi, math.tau)
        omega = float(omega_radps[i] + share * (omega_radps[i + 1] - omega_radps[i]))
        phase_rad = min(phase_rad, abs(left_rad))
        delay_s = min(delay_s, (left_rad % math.tau) / omega)
    turns = (phase + math.pi) / math.tau
    for i in np.flatnonzero(np.floor(turns[:-1]) != np.floor(turns[1:])):
        level = max(math.floor(turns[i]), math.floor(turns[i + 1]))
        share = _share(turns[i] - level, turns[i + 1] - level)
        at = float(size[i] + share * (size[i + 1] - size[i]))
        if at < 1.0:
            gain = min(gain, 1.0 / at)
    return Margins(gain, phase_rad, delay_s)


def _share(before: float, after: float) -> float:
    """Where between two samples a quantity is zero."""
    return before / (before - after) if before != after else 0.0


def exponential(matrix: Array) -> Array:
    """e^M by scaling and squaring of its Taylor series; small matrices."""
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(matrix).sum(axis=1).max()), 1e-300))) + 4)
    scaled = matrix / 2.0**halvings
    result = term = np.eye(len(matrix))
    for n in range(1, 12):
        term = term @ scaled / n
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)
