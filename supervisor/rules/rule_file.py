"""The rule file: inputs with five named sets each, rules as sentences, and what to do at each level of fear.

Sets are given by the points of scikit-fuzzy's ``trimf`` (three) or ``trapmf`` (four). The language of the sentences
is that of :mod:`supervisor.rules.sentence`.
"""

import itertools
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, WithJsonSchema, field_validator, model_validator

from trepid.causes import Cause, known_causes, unknown_cause
from trepid.config import Settings, wrong_at
from trepid.messages import Mode
from trepid.types import Share

LEVELS = ("very_low", "low", "medium", "high", "very_high")
"""The five intensities, of every input and of fear itself (inventory F02)."""

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Seconds = Annotated[float, Field(ge=0)]
FEAR = "fear"
TRUST_PREFIX = "trust_"
_POINTS_SCHEMA = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 4}
_SENTENCE_SCHEMA = {
    "type": "string",
    "pattern": rf"^if .+ then ({FEAR}|{TRUST_PREFIX}[a-z0-9_]+) is ({'|'.join(LEVELS)})( with weight | because |$)",
    "examples": ["if disagreement is high and speed is high then fear is very_high because disagreement"],
}
Points = Annotated[tuple[float, ...], WithJsonSchema(_POINTS_SCHEMA)]
Sentence = Annotated[str, WithJsonSchema(_SENTENCE_SCHEMA)]
KEYWORDS = frozenset({"if", "then", "and", "or", "not", "is", "with", "weight", "because", FEAR})
Method = Literal["monotone", "mamdani"]
"""How rules become a number; :mod:`supervisor.rules.inference` says what each promises."""


class Sets(Settings):
    """The five fuzzy sets of an input as the points of trimf (3) or trapmf (4), in order of the input's value."""

    very_low: Points
    low: Points
    medium: Points
    high: Points
    very_high: Points

    @field_validator("*")
    @classmethod
    def _is_a_shape(cls, points: Points) -> Points:
        if len(points) not in (3, 4):
            raise ValueError(f"expected 3 points (triangle) or 4 (trapezoid), got {len(points)}")
        if list(points) != sorted(points):
            raise ValueError(f"the points must not fall, got {list(points)}")
        return points

    def trapezoid(self, level: str) -> tuple[float, float, float, float]:
        """Feet and shoulders a <= b <= c <= d of a set; a triangle has b = c."""
        points = getattr(self, level)
        return points if len(points) == 4 else (points[0], points[1], points[1], points[2])


class Input(Settings):
    """One thing that is feared."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    meaning: str
    unit: str
    range: tuple[float, float]
    """The values that can be."""
    risk: Literal["rising", "falling"]
    """Which way it gets worse."""
    missing: Name = Cause.MISSING_DATA
    """The cause when there is no value. Fear is 1 then."""
    beyond: Literal["broken", "end"] = "broken"
    """What a value beyond the range is: broken data, as if missing, or as good as the end of the range."""
    sets: Sets

    @property
    def worst(self) -> float:
        """The end of the range that is feared most."""
        return self.range[1] if self.risk == "rising" else self.range[0]

    @property
    def calmest(self) -> float:
        """The end of the range that is feared least."""
        return self.range[0] if self.risk == "rising" else self.range[1]

    @property
    def riskiest_set(self) -> str:
        """Name of the set at the worst end."""
        return LEVELS[-1] if self.risk == "rising" else LEVELS[0]

    @model_validator(mode="after")
    def _sets_cover_the_range_in_order(self) -> "Input":
        low, high = self.range
        if not low < high:
            raise ValueError(f"range must rise, got {list(self.range)}")
        shapes = [self.sets.trapezoid(level) for level in LEVELS]
        if shapes[0][:2] != (low, low):
            raise ValueError(f"very_low must start as a shoulder at {low}: [{low}, {low}, ...]")
        if shapes[-1][2:] != (high, high):
            raise ValueError(f"very_high must end as a shoulder at {high}: [..., {high}, {high}]")
        for (name, left), (next_name, right) in itertools.pairwise(zip(LEVELS, shapes, strict=True)):
            _check_neighbours(name, left, next_name, right)
        return self


def _check_neighbours(name: str, left: Points, next_name: str, right: Points) -> None:
    if right[0] >= left[3]:
        raise ValueError(f"{name} and {next_name} leave a gap: they must overlap")
    if right[1] <= left[1] or right[2] <= left[2] or right[0] < left[0] or right[3] < left[3]:
        raise ValueError(f"{name} and {next_name} are not in order")
    if left[2] == left[3] or right[0] == right[1]:
        raise ValueError(f"between {name} and {next_name} an edge is vertical: fear would jump")


class Action(Settings):
    """What one level of fear means: where it stands on 0..1, how fast to drive, in which mode."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    at: Share
    """Where the level stands on fear's scale, 0 to 1."""
    speed_factor: Share
    """Share of the cruise speed; between levels it is interpolated."""
    mode: Literal[Mode.KEEP, Mode.CAUTION, Mode.STOP]


class Actions(Settings):
    """The five levels of fear."""

    very_low: Action
    low: Action
    medium: Action
    high: Action
    very_high: Action

    @property
    def all(self) -> tuple[Action, ...]:
        """In rising order of fear."""
        return tuple(getattr(self, level) for level in LEVELS)

    @model_validator(mode="after")
    def _more_fear_is_never_faster(self) -> "Actions":
        order = (Mode.KEEP, Mode.CAUTION, Mode.STOP)
        if self.very_low.at != 0 or self.very_high.at != 1:
            raise ValueError("very_low must stand at 0 and very_high at 1")
        for (name, less), (next_name, more) in itertools.pairwise(zip(LEVELS, self.all, strict=True)):
            if more.at <= less.at:
                raise ValueError(f"{next_name} must stand above {name}")
            if more.speed_factor > less.speed_factor:
                raise ValueError(f"speed_factor of {next_name} is above that of {name}: fear must slow down")
            if order.index(more.mode) < order.index(less.mode):
                raise ValueError(f"the mode of {next_name} is milder than that of {name}")
        return self


class Hysteresis(Settings):
    """How reluctantly fear is forgotten. Getting more afraid takes effect at once."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    band: Annotated[float, Field(ge=0, lt=0.2)]
    """Fear must fall this far below a level's border to leave it ..."""
    calm_after_s: Seconds
    """... and stay there this long."""
    stop_after_s: Seconds
    """A level whose mode is STOP must last this long: one bad frame only slows down."""
    recovery_per_s: Annotated[float, Field(gt=0)]
    """Greatest rise of the speed factor [1/s] ..."""
    catch_up_per_s: Annotated[float, Field(gt=0)]
    """... and while it is below the speed that the car still has."""


class RuleFile(Settings):
    """The contents of ``config/fear.yaml``."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    method: Method = "monotone"
    """monotone: more risk is never less fear, and fear reaches 0 and 1. mamdani: as scikit-fuzzy, to compare."""
    estimators: tuple[Name, ...] = ()
    """Those whose trust the rules speak of."""
    causes: dict[Name, str] = Field(default={})
    """Causes that only this file names, with their meaning; those of ``trepid.causes`` are known without."""
    inputs: Annotated[dict[Name, Input], Field(min_length=1)]
    rules: Annotated[tuple[Sentence, ...], Field(min_length=1)]
    """if A is SET and/or/not ... then fear (or trust_NAME) is LEVEL [with weight W] [because CAUSE]"""
    fear: Actions
    """What each level of fear does."""
    hysteresis: Hysteresis

    @property
    def outputs(self) -> tuple[str, ...]:
        """What a rule may speak of behind ``then``."""
        return (FEAR, *(TRUST_PREFIX + name for name in self.estimators))

    @property
    def known_causes(self) -> frozenset[str]:
        """Causes that a rule may name; a rule without ``because`` has the name of its first input."""
        return known_causes([*self.causes, *self.inputs])

    @model_validator(mode="after")
    def _missing_inputs_have_known_causes(self) -> "RuleFile":
        known = self.known_causes
        for name, spec in self.inputs.items():
            problem = unknown_cause(spec.missing, known)
            if problem:
                raise wrong_at(("inputs", name, "missing"), problem)
        return self

    @model_validator(mode="after")
    def _names_are_unambiguous(self) -> "RuleFile":
        for name in self.inputs:
            if name in KEYWORDS or name in self.outputs:
                raise wrong_at(
                    ("inputs", name), f"{name!r} is a word of the rule language; choose another name"
                )
        for index, name in enumerate(self.estimators):
            if name in self.estimators[:index]:
                raise wrong_at(("estimators", index), f"{name!r} stands here twice")
        return self
