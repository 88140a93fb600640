"""Design and analysis of the LQI steering loop with python-control: gains, margins, pictures.

    minimise ∫ xᵀQx + u² dt    over u = -K·x    where x' = A·x + B·u(t - T)

with the states and weights of :mod:`controller.laws.lqi`. The prediction over the dead time T

    x̂(t + T) = e^(AT)·x + ∫ e^(Aθ)·B·u(t - θ) dθ

is exact, so the closed loop has the poles of A - B·K. With G = (jω - A)⁻¹B the loop, broken at the input, is

    L = K·e^(AT)·G·e^(-jωT) / (1 + K·(G - e^(AT)·G·e^(-jωT)))

Manitius and Olbrot, IEEE Trans. Automatic Control 24 (1979); Anderson and Moore, Optimal Control (1990), section
3.3 and chapter 5 (margins). The import of python-control takes seconds: :mod:`controller.laws.lqi` imports
this module only to compute gains that are not stored.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # before python-control imports pyplot

import control
import matplotlib.pyplot as plt
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from controller.laws.lqi_settings import Design, Gains, Lags, LqiSettings, Margins
from trepid.bounds import at_most
from trepid.config import InputError
from trepid.types import Array

_SLOWER = 0.92  # factor on the bandwidth until the margins hold
_OMEGA = np.geomspace(0.02, 200.0, 240)  # frequencies, in bandwidths, of the frequency response
_PADE_ORDER = 8
_STEP_S = 10.0  # of a picture


def model(lags: Lags) -> tuple[Array, Array, list[int]]:
    """A (n, n), B (n,) and the n indices in (z, e, w, p, q) of the states; a lag of 0 takes its state away."""
    a = np.zeros((5, 5))
    b = np.zeros(5)
    states = [0, 1, 2]
    a[0, 1] = a[1, 2] = 1.0
    into, rate = 2, 1.0
    for state, lag_s in ((3, lags.tyres_s), (4, lags.steering_s)):
        if lag_s > 0.0:
            a[into, state] = rate
            a[state, state] = -1.0 / lag_s
            into, rate = state, 1.0 / lag_s
            states.append(state)
    b[into] = rate
    return a[np.ix_(states, states)], b[states], states


def design(speed_mps: float, lags: Lags, settings: LqiSettings) -> Design:
    """The loop of the highest bandwidth at ``speed_mps``, up to that of ``settings``, that has the margins."""
    need, lags = settings.margins, lags.noticeable()
    least_s = need.delay_s + need.delay_share * sum(lags)
    omega = at_most(settings.bandwidth_radps, settings.bandwidth_radpm * speed_mps)
    while True:
        gains, margins = _at(omega, lags, settings)
        robust = margins.gain_db >= need.gain_db and margins.phase_rad >= need.phase_rad
        if robust and margins.delay_s >= least_s:
            return Design(speed_mps, omega, gains, margins)
        omega *= _SLOWER


@lru_cache(maxsize=1024)
def _at(omega: float, lags: Lags, settings: LqiSettings) -> tuple[Gains, Margins]:
    """Gains and margins at bandwidth ω. Time is counted in 1/ω, so that all numbers are near one."""
    scaled = Lags(*(omega * lag_s for lag_s in lags))
    a, b, states = model(scaled)
    weights = np.diag([settings.integral**2, 1.0, settings.damping**2, 0.0, 0.0])[np.ix_(states, states)]
    if settings.integral == 0.0:  # an integral without weight cannot be stabilised
        a, b, weights, states = a[1:, 1:], b[1:], weights[1:, 1:], states[1:]
    k = np.asarray(control.lqr(a, b[:, None], weights, [[1.0]])[0])[0]
    found = margins(loop(a, b, k, scaled.dead_s, _OMEGA), _OMEGA)
    full = np.zeros(5)
    full[states] = k * omega ** np.array([3.0, 2.0, 1.0, 0.0, 0.0])[states]
    return Gains(*full.tolist()), found._replace(delay_s=found.delay_s / omega)


def loop(a: Array, b: Array, k: Array, dead_s: float, omega_radps: Array) -> NDArray[np.complex128]:
    """L(jω) of the module docstring, shape of ω."""
    ahead = scipy.linalg.expm(a * dead_s)
    s = 1j * omega_radps
    inputs = np.broadcast_to(b[:, None], (len(s), len(b), 1))
    g = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, inputs)
    late = (k @ ahead @ g)[:, 0] * np.exp(-s * dead_s)
    return np.asarray(late / (1.0 + (k @ g)[:, 0] - late))


def margins(response: NDArray[np.complex128], omega_radps: Array) -> Margins:
    """The smallest margins of a loop that is stable when closed, from its L(jω) over rising ω."""
    gains, phases_deg, _, _, omega, _ = control.stability_margins(
        control.FRD(response, omega_radps), returnall=True
    )
    lefts_rad = [math.remainder(math.radians(phase_deg), math.tau) for phase_deg in phases_deg]
    return Margins(
        gain=min((float(gain) for gain in gains if gain > 1.0), default=math.inf),
        phase_rad=min((abs(left_rad) for left_rad in lefts_rad), default=math.pi),
        delay_s=min(
            (left_rad % math.tau / float(at) for left_rad, at in zip(lefts_rad, omega, strict=True)),
            default=math.inf,
        ),
    )


def rational_loop(found: Design, lags: Lags) -> control.StateSpace:
    """L(s) of a design with e^(-sT) as a Padé approximant of order 8."""
    a, b, k = _matrices(found, lags)
    delay = control.ss(control.tf(*control.pade(lags.dead_s, _PADE_ORDER)))
    now = control.ss(a, b[:, None], k[None, :], 0.0)
    late = delay * control.ss(a, b[:, None], (k @ scipy.linalg.expm(a * lags.dead_s))[None, :], 0.0)
    return late * control.feedback(1.0, now - late)


def disk_margin(found: Design, lags: Lags) -> float:
    """Balanced disk margin α of a design: gain and phase may vary together within the disk of size α.

    Seiler, Packard, Gahinet, An Introduction to Disk Margins, IEEE Control Systems Magazine 40 (2020).
    """
    margin, _, _ = control.disk_margins(rational_loop(found, lags), found.bandwidth_radps * _OMEGA, skew=0.0)
    return float(margin)


def _around_bandwidth(found: Design, lags: Lags) -> control.FrequencyResponseData:
    """L(jω) of a design around its bandwidth."""
    a, b, k = _matrices(found, lags)
    omega = found.bandwidth_radps * np.geomspace(0.1, 20.0, 300)
    return control.FRD(loop(a, b, k, lags.dead_s, omega), omega)


def step_response(found: Design, lags: Lags, time_s: Array) -> Array:
    """Offset after a step of 1 m of the demanded offset, shape of ``time_s``: A - B·K, one dead time later."""
    a, b, k = _matrices(found, lags)
    offset = 1 if found.gains.integral_1ps3 else 0
    demand = b * k[offset]
    if offset:
        demand = demand - np.eye(len(a))[0]  # z' = e - demand
    closed = control.ss(a - np.outer(b, k), demand[:, None], np.eye(len(a))[[offset]], 0.0)
    response = control.step_response(closed, T=np.linspace(0.0, float(time_s[-1]), 2000))
    return np.interp(time_s - lags.dead_s, response.time, np.asarray(response.outputs), left=0.0)


def _matrices(found: Design, lags: Lags) -> tuple[Array, Array, Array]:
    """A, B and K of a design; without the integral state where its gain is 0."""
    a, b, states = model(lags.noticeable())
    if found.gains.integral_1ps3 == 0.0:
        a, b, states = a[1:, 1:], b[1:], states[1:]
    return a, b, np.array(found.gains)[states]


def draw(path: Path, designs: Sequence[Design], lags: Sequence[Lags], *, title: str) -> None:
    """Magnitude, phase and step response of each design as a picture; equal ones once. Raises InputError."""
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 10.0))
    time_s = np.linspace(0.0, _STEP_S, 500)
    for _, equal in groupby(zip(designs, lags, strict=True), key=lambda pair: (pair[0].gains, pair[1])):
        (found, lag), *others = equal
        label = f"{found.speed_mps:g} m/s" + (f" to {others[-1][0].speed_mps:g} m/s" if others else "")
        control.bode_plot(_around_bandwidth(found, lag), ax=axes[:2, None], title="", show_legend=False)
        axes[2].plot(time_s, step_response(found, lag, time_s), label=label)
    axes[0].set_title(title)
    axes[0].set_ylabel("|L(jω)|")
    axes[1].set_ylabel("phase of L [deg]")
    axes[1].set_xlabel("ω [rad/s]")
    axes[2].set_xlabel("time [s]")
    axes[2].set_ylabel("offset after a step of 1 m [m]")
    axes[2].grid(True)
    axes[2].legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=6, frameon=False)  # on no curve
    figure.tight_layout()
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise InputError(f"--picture {path}: cannot be written: {error}") from None
    finally:
        plt.close(figure)
