"""The parameters of a scenario: fields, and the values that each may take.

In a scenario file::

    vary:
      start.offset_m: [-0.5, 0.5]                          # a range
      plant.friction: {from: 0.2, to: 1.0, log: true}      # evenly in the logarithm
      lead.speed_mps: {choices: [0, 3, 6]}                 # any of these values
      segments.1.curvature_1pm, segments.2.curvature_1pm: [0.01, 0.05]  # both fields get the same value

Every parameter is sampled in the unit interval and mapped to its values from there.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    JsonValue,
    Tag,
    ValidationError,
    model_validator,
)

from trepid.config import InputError, Settings, complaint, position, put

S = TypeVar("S", bound=BaseModel)

INSIDE = 0.382  # an inner point of a range, at which a field of whole numbers refuses the value
SIGNIFICANT_DIGITS = 6  # of a drawn value, so that it can be typed


class Range(Settings):
    """All values between two ends, inclusive."""

    model_config = ConfigDict(serialize_by_alias=True)

    from_: float = Field(alias="from")
    to: float
    log: bool = False  # uniform in the logarithm; both ends must be positive
    whole: bool = False  # whole numbers only
    steps: Annotated[int, Field(ge=2)] = 5  # values in a grid

    @model_validator(mode="after")
    def _spans_something(self) -> Self:
        if not self.from_ < self.to:
            raise ValueError(f"from {self.from_:g} must be less than to {self.to:g}")
        if self.log and self.from_ <= 0:
            raise ValueError(f"from {self.from_:g} must be positive for log")
        return self

    def value(self, unit: float) -> float | int:
        """The value at ``unit`` in 0..1: from + (to - from)·u, or from·(to/from)^u for ``log``."""
        if self.log:
            value = self.from_ * (self.to / self.from_) ** unit
        else:
            value = self.from_ + (self.to - self.from_) * unit
        value = min(max(float(f"{value:.{SIGNIFICANT_DIGITS}g}"), self.from_), self.to)
        return round(value) if self.whole else value

    def unit(self, value: float) -> float:
        """The position of ``value`` in 0..1, clipped."""
        value = min(max(value, self.from_), self.to)
        if self.log:
            return math.log(value / self.from_) / math.log(self.to / self.from_)
        return (value - self.from_) / (self.to - self.from_)

    def grid(self) -> tuple[JsonValue, ...]:
        """``steps`` evenly spaced values with both ends."""
        values = (self.value(step / (self.steps - 1)) for step in range(self.steps))
        return tuple(dict.fromkeys(values))  # whole numbers may be fewer

    def probes(self) -> tuple[JsonValue, ...]:
        """The values that the field must accept: both ends, and one inside."""
        return self.value(0.0), self.value(1.0), self.value(INSIDE)


class Choices(Settings):
    """A list of values."""

    choices: Annotated[tuple[JsonValue, ...], Field(min_length=1)]

    def value(self, unit: float) -> JsonValue:
        """The value at ``unit`` in 0..1; all are equally likely."""
        return self.choices[min(int(unit * len(self.choices)), len(self.choices) - 1)]

    def grid(self) -> tuple[JsonValue, ...]:
        """All values."""
        return self.choices

    probes = grid


def _in_full(value: Any) -> Any:
    """``[low, high]`` as a range mapping."""
    if isinstance(value, list | tuple) and len(value) == 2:
        return {"from": value[0], "to": value[1]}
    if not isinstance(value, dict | Range | Choices):
        raise ValueError("expected a range [from, to] or {from: ..., to: ...}, or {choices: [...]}")
    return value


def _kind(value: Any) -> str:
    has_choices = isinstance(value, Choices) or (isinstance(value, dict) and "choices" in value)
    return "Choices" if has_choices else "Range"


Variation = Annotated[
    Annotated[Choices, Tag("Choices")] | Annotated[Range, Tag("Range")],
    Discriminator(_kind),
    BeforeValidator(_in_full, json_schema_input_type=tuple[float, float] | Range | Choices),
]
"""A range or choices, in the notation of a scenario file."""


def fields(parameter: str) -> tuple[str, ...]:
    """The dotted fields that a parameter sets, all to the same value."""
    return tuple(field.strip() for field in parameter.split(","))


def change_settings(settings: S, parameters: Mapping[str, JsonValue]) -> S:
    """``settings`` with the values of ``parameters``, validated, without ``vary``.

    Raises LookupError for an unknown field and ValidationError for an invalid value.
    """
    return type(settings).model_validate(_change_fields(settings, parameters))


def _change_fields(settings: BaseModel, parameters: Mapping[str, JsonValue]) -> dict[str, Any]:
    data = settings.model_dump(mode="json", exclude_unset=True, exclude={"vary"})
    for parameter, value in parameters.items():
        for field in fields(parameter):
            put(data, field, value)
    return data


def check_vary(
    settings: S,
    vary: Mapping[str, Choices | Range],
    data: object,
    source: Path | str,
    *,
    misfit: Callable[[S], str] | None = None,
) -> None:
    """Raise InputError for a parameter that is no field of ``settings`` or a value that is invalid.

    ``misfit`` returns the contradiction in settings, "" for none. The error has the position of the parameter in
    ``data``, the YAML read from ``source``.
    """
    for parameter, variation in vary.items():
        for value in variation.probes():
            problem = _problem(settings, parameter, value, misfit)
            if problem:
                line, column = position(data, ("vary", parameter))
                raise InputError(f"{source}:{line}:{column}: vary: {problem} (for {value!r})")


def _problem(settings: S, parameter: str, value: JsonValue, misfit: Callable[[S], str] | None) -> str:
    """The error of ``value`` for ``parameter``; "" for a valid value."""
    try:
        data = _change_fields(settings, {parameter: value})
    except LookupError as error:
        return f"{parameter}: {error.args[0]}"
    try:
        changed_settings = type(settings).model_validate(data)
    except ValidationError as error:
        return complaint(error, data, type(settings))
    return misfit(changed_settings) if misfit else ""
