"""Parameters of a search, and costs: ``config/tune.yaml``, ``config/driving_search.yaml``."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from trepid.config import InputError, Settings
from trepid.types import NonNegative

DIGITS = 3  # resolution within the span of a parameter


class Costs(Settings):
    """Costs, whose sum is minimised. See :mod:`sim_harness.tuning.score`."""

    departure: NonNegative  # or collision, of the average run
    nuisance_per_km: NonNegative  # of slow-downs without a cause
    speed_loss: NonNegative  # of the mean speed on calm roads, as a share
    missed_warning: NonNegative  # 1 - AUROC of fear against departures of drives without fear


class Span(Settings):
    """Range of a number."""

    low: float
    high: float
    log: bool = False  # searched by its logarithm; low is above 0
    whole: bool = False

    @model_validator(mode="after")
    def _rises(self) -> "Span":
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} must be below high {self.high:g}")
        if self.log and not self.low > 0:
            raise ValueError(f"low {self.low:g} must be above 0 for a range by the logarithm")
        return self

    def round_value(self, value: float) -> float:
        """``value`` rounded: whole, to DIGITS digits where it is searched by its logarithm, else to a thousandth
        of the span.
        """
        if self.whole:
            return float(round(min(max(value, self.low), self.high)))
        if self.log:
            return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)
        step = 10.0 ** round(math.log10((self.high - self.low) / 10**DIGITS))
        return min(max(round(round(value / step) * step, 12), self.low), self.high)


class TuneSettings(Settings):
    """The contents of ``config/tune.yaml``."""

    scenarios: tuple[str, ...]
    unseen: tuple[str, ...]  # further scenarios for the evaluation, besides new cases of the others
    cases: Annotated[int, Field(ge=1)]  # of each scenario
    costs: Costs
    parameters: dict[str, Span]  # name of a number (see tuning/numbers.py) -> its range


def parse_vary(texts: list[str]) -> dict[str, Span]:
    """``NAME=LOW..HIGH`` texts of ``--vary``. Raises InputError."""
    spans = {}
    for text in texts:
        name, _, span = text.partition("=")
        low, dots, high = span.partition("..")
        try:
            spans[name] = Span(low=float(low), high=float(high))
        except ValueError as error:
            what = "low must be below high" if dots and low and high else "expected NAME=LOW..HIGH"
            raise InputError(f"--vary {text}: {what}") from error
    return spans
