"""The true vehicle ahead with the errors of the camera's lead detector, for sweeps without rendering.

Each error is a first-order Gauss-Markov process, e' = a·e + √(1 − a²)·σ·n with a = exp(−dt/τ), with the
measured size and correlation time (Gelb, Applied Optimal Estimation (1974), section 3.7). The detection is lost and
regained with rates that depend on the distance; the speed follows the true one with a lag.
``trepid bench follow`` measures the numbers on rendered frames and compares them with ``config/lead_model.yaml``.
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import LeadVehicle
from trepid.types import Positive, Share


class LeadModelSettings(Settings):
    """``config/lead_model.yaml``. Lists of equal length, interpolated over the distance."""

    distances_m: Annotated[tuple[float, ...], Field(min_length=2)]
    distance_bias: tuple[float, ...]  # share of the distance
    distance_sigma: tuple[float, ...]  # share of the distance
    lateral_sigma_m: tuple[float, ...]
    speed_sigma_mps: tuple[float, ...]
    seen: tuple[Share, ...]  # share of the time
    memory_s: Positive  # τ of all errors
    lost_for_s: Positive  # mean length of a loss of sight
    speed_lag_s: Positive

    @model_validator(mode="after")
    def _same_lengths(self) -> "LeadModelSettings":
        lists = ("distance_bias", "distance_sigma", "lateral_sigma_m", "speed_sigma_mps", "seen")
        for name in lists:
            if len(getattr(self, name)) != len(self.distances_m):
                raise ValueError(f"{name} must have {len(self.distances_m)} numbers, one for each distance")
        return self

    def at(self, name: str, distance_m: float) -> float:
        """A number at a distance."""
        return float(np.interp(distance_m, self.distances_m, getattr(self, name)))


class LeadModel:
    """Adds the errors of the detector to the true lead."""

    def __init__(self, settings: LeadModelSettings, *, seed: int) -> None:
        self._settings = settings
        self._rng = np.random.default_rng((seed, 30))
        self._errors = self._rng.standard_normal(3)
        self._detected = True
        self._speed_mps: float | None = None
        self._t_s: float | None = None

    def step(self, lead: LeadVehicle | None, *, within_m: float = math.inf) -> LeadVehicle | None:
        """The output of the detector for the true ``lead``; None in a run without other vehicles.

        ``within_m``: distance from the front bumper up to which the air lets it see.
        """
        if lead is None:
            return None
        if lead.distance_m is not None and lead.distance_m > within_m:
            lead = LeadVehicle(t_s=lead.t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)
        s, dt_s = self._settings, 0.0 if self._t_s is None else lead.t_s - self._t_s
        self._t_s = lead.t_s
        kept = math.exp(-dt_s / s.memory_s)
        self._errors = kept * self._errors + math.sqrt(1 - kept**2) * self._rng.standard_normal(3)
        chance = float(self._rng.random())
        if lead.distance_m is None or lead.lateral_m is None or lead.speed_mps is None:
            self._speed_mps, self._detected = None, False
            return lead
        self._detect(lead.distance_m, dt_s, chance)
        before = lead.speed_mps if self._speed_mps is None else self._speed_mps
        self._speed_mps = lead.speed_mps + (before - lead.speed_mps) * math.exp(-dt_s / s.speed_lag_s)
        if not self._detected:
            return LeadVehicle(t_s=lead.t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)
        along, aside, speed = self._errors.tolist()
        near_m = lead.distance_m
        ratio = 1 + s.at("distance_bias", near_m) + s.at("distance_sigma", near_m) * along
        return LeadVehicle(
            t_s=lead.t_s,
            distance_m=near_m * ratio,
            lateral_m=lead.lateral_m + s.at("lateral_sigma_m", near_m) * aside,
            speed_mps=self._speed_mps + s.at("speed_sigma_mps", near_m) * speed,
            confidence=1.0,
        )

    def _detect(self, distance_m: float, dt_s: float, chance: float) -> None:
        """Lose or regain the detection: a Markov chain with the measured share of detections."""
        s = self._settings
        seen = min(max(s.at("seen", distance_m), 1e-3), 1 - 1e-6)
        found_1ps = 1 / s.lost_for_s
        lost_1ps = found_1ps * (1 - seen) / seen
        rate_1ps = lost_1ps if self._detected else found_1ps
        if chance < 1 - math.exp(-rate_1ps * dt_s):
            self._detected = not self._detected


def build_lead_model(*, seed: int) -> LeadModel:
    """The model in ``config/``. Raises InputError."""
    return LeadModel(load(CONFIG_DIR / "lead_model.yaml", LeadModelSettings), seed=seed)
