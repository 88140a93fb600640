"""A time interval of a run."""

from typing import Self

from pydantic import model_validator

from trepid.config import Settings
from trepid.types import NonNegative, Positive


class Span(Settings):
    """A time interval from the start of the run; without `to_s` it lasts to the end."""

    from_s: NonNegative
    to_s: Positive | None = None

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s {self.to_s:g} must be after from_s {self.from_s:g}")
        return self

    def active(self, elapsed_s: float) -> bool:
        """True within the interval."""
        return self.from_s <= elapsed_s and (self.to_s is None or elapsed_s < self.to_s)
