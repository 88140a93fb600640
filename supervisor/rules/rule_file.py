"""The rule file: inputs with five named sets each, rules as sentences, and the action at each level of fear.

A set is given by the points of scikit-fuzzy's ``trimf`` (three) or ``trapmf`` (four), or by any other of its
membership functions with its parameters. The language of the sentences is that of :mod:`supervisor.rules.sentence`.
"""

import itertools
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    WithJsonSchema,
    model_validator,
)

from supervisor.rules.shapes import CompiledSet, FuzzySet, compile_set, polyline
from trepid.causes import Cause, known_causes, unknown_cause
from trepid.config import CONFIG_DIR, Settings, json_schema, wrong_at
from trepid.messages import Mode
from trepid.types import NonNegative, Positive, Share

LEVELS = ("very_low", "low", "medium", "high", "very_high")
"""The five intensities, of every input and of fear itself."""

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
FEAR = "fear"
PATH_JITTER, FORMER_PATH_JITTER = "_path_jitter", "_unrest"
"""Ending of an input name, and its former spelling, which still works with a warning."""
SIGHT = "sight"
"""Input that was a confidence in former rule files, now called seen_confidence."""
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
"""Inference methods; :mod:`supervisor.rules.inference` describes their properties."""


Two = tuple[float, float]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]


class Membership(Settings):
    """One membership function of scikit-fuzzy with its parameters, such as ``{gaussmf: [5.0, 0.8]}``."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    trimf: Three | None = None
    """Triangle: left foot, peak, right foot."""
    trapmf: Four | None = None
    """Trapezoid: left foot, left shoulder, right shoulder, right foot."""
    gaussmf: Two | None = None
    """Gaussian: mean, standard deviation."""
    gauss2mf: Four | None = None
    """Two Gaussians: mean and standard deviation of the left edge, then of the right edge."""
    gbellmf: Three | None = None
    """Generalised bell 1 / (1 + |(x - c) / a|^2b): a, b, c."""
    sigmf: Two | None = None
    """Sigmoid 1 / (1 + exp(-c (x - b))): b, c; it falls where c < 0."""
    dsigmf: Four | None = None
    """Difference of two sigmoids: b1, c1, b2, c2."""
    psigmf: Four | None = None
    """Product of two sigmoids: b1, c1, b2, c2."""
    smf: Two | None = None
    """S curve: foot, shoulder."""
    zmf: Two | None = None
    """Z curve: shoulder, foot."""
    pimf: Four | None = None
    """S curve and Z curve: left foot, left shoulder, right shoulder, right foot."""
    piecemf: Three | None = None
    """Two lines a, b, c that rise to 1 at c: b (x - a) / (c (b - a)) up to b, then x / c."""
    polyline: Annotated[tuple[Two, ...], Field(min_length=2)] | None = None
    """Corners [x, degree] of straight lines, from left to right. Not a function of scikit-fuzzy."""

    @model_validator(mode="after")
    def _is_one_function(self) -> "Membership":
        if len(self.model_fields_set) != 1 or getattr(self, self.function) is None:
            known = ", ".join(type(self).model_fields)
            raise ValueError(f"expected one membership function with its parameters, of {known}")
        return self

    @property
    def function(self) -> str:
        """Name of the function in scikit-fuzzy."""
        return next(iter(self.model_fields_set))

    @property
    def parameters(self) -> tuple[Any, ...]:
        """Parameters of the function."""
        return tuple(getattr(self, self.function))


def _kind(value: object) -> str:
    return "Membership" if isinstance(value, dict | Membership) else "points"


SetSpec = Annotated[
    Annotated[Points, Tag("points")] | Annotated[Membership, Tag("Membership")], Discriminator(_kind)
]


class Sets(Settings):
    """The five fuzzy sets of an input, from low to high values: points of trimf or trapmf, or a function."""

    very_low: SetSpec
    low: SetSpec
    medium: SetSpec
    high: SetSpec
    very_high: SetSpec


def _feet_and_shoulders(points: Points) -> Four:
    """Feet and shoulders a <= b <= c <= d of a triangle (b = c) or trapezoid. Raises ValueError."""
    if len(points) not in (3, 4):
        raise ValueError(f"expected 3 points (triangle) or 4 (trapezoid), got {len(points)}")
    if list(points) != sorted(points):
        raise ValueError(f"the points must not fall, got {list(points)}")
    return (points[0], points[1], points[-2], points[-1])


class Input(Settings):
    """A measured quantity with its fuzzy sets and the direction of its risk."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    meaning: str
    unit: str
    range: tuple[float, float]
    """Smallest and greatest possible value."""
    risk: Literal["rising", "falling"]
    """Direction in which the risk grows: rising values or falling values."""
    missing: Name = Cause.MISSING_DATA
    """The cause when the value is missing. Fear is 1 then."""
    beyond: Literal["broken", "end"] = "broken"
    """Meaning of a value beyond the range. broken: as a missing value; end: as the end of the range."""
    tolerance: Annotated[float, Field(gt=0, le=0.05)] = 0.001
    """Greatest allowed difference in degree between a membership function and the lines it is compiled into."""
    sets: Sets

    _shapes: dict[str, FuzzySet] = PrivateAttr(default_factory=dict)
    _errors: dict[str, float] = PrivateAttr(default_factory=dict)

    @property
    def worst(self) -> float:
        """The end of the range with the greatest risk."""
        return self.range[1] if self.risk == "rising" else self.range[0]

    @property
    def calmest(self) -> float:
        """The end of the range with the least risk."""
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
        for level in LEVELS:
            try:
                shape, error = _compile_set(getattr(self.sets, level), self.range, self.tolerance)
            except ValueError as problem:
                raise wrong_at(("sets", level), str(problem)) from problem
            self._shapes[level] = shape
            if shape.rise or shape.fall:
                self._errors[level] = error
        shapes = list(self._shapes.values())
        if shapes[0][:2] != (low, low):
            raise ValueError(
                f"no set is 1 at {low}: very_low must start as a shoulder there, [{low}, {low}, ...]"
            )
        if shapes[-1][2:4] != (high, high):
            raise ValueError(
                f"no set is 1 at {high}: very_high must end as a shoulder there, [..., {high}, {high}]"
            )
        for (name, left), (next_name, right) in itertools.pairwise(zip(LEVELS, shapes, strict=True)):
            _check_neighbours(name, left, next_name, right)
        return self

    @property
    def shapes(self) -> dict[str, FuzzySet]:
        """The five sets by name, compiled into straight lines."""
        return self._shapes

    @property
    def errors(self) -> dict[str, float]:
        """Greatest difference in degree between each membership function and its lines; points have none."""
        return self._errors


def _compile_set(spec: SetSpec, span: Two, tolerance: float) -> CompiledSet:
    """The set as straight lines over the range ``span``. Raises ValueError."""
    if isinstance(spec, tuple):
        return CompiledSet(FuzzySet(*_feet_and_shoulders(spec)), 0.0)
    if spec.function in ("trimf", "trapmf"):
        return CompiledSet(FuzzySet(*_feet_and_shoulders(spec.parameters)), 0.0)
    if spec.function == "polyline":
        return CompiledSet(polyline(spec.parameters), 0.0)
    return compile_set(spec.function, spec.parameters, span, tolerance)


def _check_neighbours(name: str, left: FuzzySet, next_name: str, right: FuzzySet) -> None:
    if right.a >= left.d:
        raise ValueError(
            f"{name} and {next_name} leave a gap: no set covers {left.d:g} to {right.a:g}; they must overlap"
        )
    curved = left.rise or left.fall or right.rise or right.fall  # whose feet may lie far out, as a bell's do
    feet_fall = not curved and (right.a < left.a or right.d < left.d)
    if right.b <= left.b or right.c <= left.c or feet_fall:
        raise ValueError(f"{name} and {next_name} are not in order")
    if left.c == left.d or right.a == right.b:
        raise ValueError(f"between {name} and {next_name} an edge is vertical: fear would jump")


def level_sets(at: tuple[float, ...]) -> dict[str, FuzzySet]:
    """The five sets of an output: triangles at the positions ``at``, 0 at the positions of their neighbours."""
    feet = (at[0], *at, at[-1])
    return {level: FuzzySet(feet[k], at[k], at[k], feet[k + 2]) for k, level in enumerate(LEVELS)}


class Action(Settings):
    """The action at one level of fear: its position on 0..1, the speed factor and the mode."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    at: Share
    """Position of the level on the scale of fear, 0 to 1."""
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
    """Delays of a fall of fear. A rise of fear takes effect at once."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    band: Annotated[float, Field(ge=0, lt=0.2)]
    """Fear must fall this far below a level's border to leave it ..."""
    calm_after_s: NonNegative
    """... and stay there this long."""
    stop_after_s: NonNegative
    """Time for which a level with the mode STOP must last: one bad frame only slows the vehicle down."""
    recovery_per_s: Positive
    """Greatest rise of the speed factor [1/s] ..."""
    catch_up_per_s: Positive
    """... and while it is below the present speed of the vehicle."""


class RuleFile(Settings):
    """The contents of ``config/fear.yaml``."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    method: Method = "monotone"
    """monotone: fear never falls as a risk rises, and reaches 0 and 1. mamdani: as scikit-fuzzy, for comparison."""
    estimators: tuple[Name, ...] = ()
    """Estimators with rules for their trust."""
    causes: dict[Name, str] = Field(default={})
    """Causes that only this file names, with their meaning; those of ``trepid.causes`` are known without."""
    without: tuple[Name, ...] = ()
    """Causes named in ``config/supervisor.yaml`` that no rule of this file gives; all others must be given."""
    inputs: Annotated[dict[Name, Input], Field(min_length=1)]
    rules: Annotated[tuple[Sentence, ...], Field(min_length=1)]
    """if A is SET and/or/not ... then fear (or trust_NAME) is LEVEL [with weight W] [because CAUSE]"""
    fear: Actions
    """Action at each level of fear."""
    hysteresis: Hysteresis

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names that may follow ``then`` in a rule."""
        return (FEAR, *(TRUST_PREFIX + name for name in self.estimators))

    @property
    def known_causes(self) -> frozenset[str]:
        """Causes that a rule may name; a rule without ``because`` has the name of its first input."""
        return known_causes([*self.causes, *self.inputs])

    @model_validator(mode="after")
    def _names_are_known_and_unambiguous(self) -> "RuleFile":
        named = [(("inputs", name, "missing"), spec.missing) for name, spec in self.inputs.items()]
        for path, cause in [
            *named,
            *((("without", index), cause) for index, cause in enumerate(self.without)),
        ]:
            problem = unknown_cause(cause, self.known_causes)
            if problem:
                raise wrong_at(path, problem)
        if SIGHT in self.inputs and self.inputs[SIGHT].range[1] <= 1.0:
            problem = (
                "sight is the way seen over that of a stop, 0 to 5; its former meaning is seen_confidence"
            )
            raise wrong_at(("inputs", SIGHT, "range"), problem)
        for name in self.inputs:
            if name in KEYWORDS or name in self.outputs:
                problem = f"{name!r} is a keyword of the rule language; choose another name"
                raise wrong_at(("inputs", name), problem)
        for index, name in enumerate(self.estimators):
            if name in self.estimators[:index]:
                raise wrong_at(("estimators", index), f"{name!r} is listed twice")
        return self


SCHEMA_FILE = CONFIG_DIR / "schema" / "fear.json"
"""The output of ``trepid fear schema``. Rule files name it in their first line, for editors."""


def rule_schema() -> str:
    """The JSON schema of rule files, as text."""
    return json_schema(RuleFile, "Trepid fear rules")
