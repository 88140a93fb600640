"""Settings, gains and margins of :mod:`controller.laws.lqi`."""

import math
from typing import Annotated, NamedTuple

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, Positive

SPEEDS_MPS = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 56.0, 80.0)
_SHORTEST_LAG_S = 1e-3  # shorter lags are left out of the model


class MarginSettings(Settings):
    """``lateral.lqi.margins``: smallest margins that a design may have."""

    gain_db: NonNegative
    phase_rad: Annotated[float, Field(ge=0, lt=math.pi / 2)]
    delay_s: NonNegative
    delay_share: NonNegative  # share of dead time plus lags, added to delay_s


class LqiSettings(Settings):
    """``lateral.lqi`` in ``config/controller.yaml``."""

    bandwidth_radpm: Positive  # ω_s
    bandwidth_radps: Positive  # ω_t
    damping: NonNegative  # d
    integral: NonNegative  # i
    max_integral_mps2: NonNegative  # largest demand of the integral
    near_m: Positive  # r₀
    far_radps: Positive  # bandwidth far from the centre
    max_approach_rad: Annotated[float, Field(gt=0, lt=1.5)]
    max_approach_mps: Positive
    margins: MarginSettings


class Gains(NamedTuple):
    """u = -(integral·z + offset·e + sideways·w + path·p + wheel·q)."""

    integral_1ps3: float
    offset_1ps2: float
    sideways_1ps: float
    path: float
    wheel: float


class Margins(NamedTuple):
    """Smallest errors at the input of the plant that make the loop unstable."""

    gain: float  # factor up; inf: none does
    phase_rad: float
    delay_s: float

    @property
    def gain_db(self) -> float:
        """``gain`` in decibels."""
        return 20.0 * math.log10(self.gain) if self.gain < math.inf else math.inf


class Design(NamedTuple):
    """The loop at one speed."""

    speed_mps: float
    bandwidth_radps: float
    gains: Gains
    margins: Margins


class Lags(NamedTuple):
    """Dead time and lags of the loop [s]."""

    dead_s: float
    steering_s: float
    tyres_s: float

    def noticeable(self) -> "Lags":
        """The same with lags below a millisecond set to 0: their poles would only cost digits."""
        lasting = (lag_s if lag_s > _SHORTEST_LAG_S else 0.0 for lag_s in (self.steering_s, self.tyres_s))
        return Lags(self.dead_s, *lasting)
