"""Bode and step diagrams of the LQI steering loop, drawn by python-control and matplotlib."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # before python-control imports pyplot

import control
import matplotlib.pyplot as plt
import numpy as np

from controller.laws.lqi_design import frequency_response, step_response
from controller.laws.lqi_settings import Design, Lags
from trepid.config import InputError

DURATION_S = 10.0


def draw(path: Path, designs: Sequence[Design], lags: Sequence[Lags], *, title: str) -> None:
    """Magnitude, phase and step response of each design as a picture; equal ones once. Raises InputError."""
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 10.0))
    time_s = np.linspace(0.0, DURATION_S, 500)
    for _, equal in groupby(zip(designs, lags, strict=True), key=lambda pair: (pair[0].gains, pair[1])):
        (found, lag), *others = equal
        label = f"{found.speed_mps:g} m/s" + (f" to {others[-1][0].speed_mps:g} m/s" if others else "")
        control.bode_plot(frequency_response(found, lag), ax=axes[:2, None], title="", show_legend=False)
        axes[2].plot(time_s, step_response(found, lag, time_s), label=label)
    axes[0].set_title(title)
    axes[0].set_ylabel("|L(jω)|")
    axes[1].set_ylabel("phase of L [deg]")
    axes[1].set_xlabel("ω [rad/s]")
    axes[2].set_xlabel("time [s]")
    axes[2].set_ylabel("offset after a step of 1 m [m]")
    axes[2].grid(True)
    axes[2].legend()
    figure.tight_layout()
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise InputError(f"--picture {path}: cannot be written: {error}") from None
    finally:
        plt.close(figure)
