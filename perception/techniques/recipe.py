"""``config/pipelines.yaml``: named pipelines as short lists of stages, checked on reading."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from pydantic import Field, create_model
from ruamel.yaml.comments import CommentedMap

from perception.techniques.stages import KINDS
from trepid.config import CONFIG_DIR, InputError, Settings, fault_line, parse, read, texts
from trepid.messages import EstimateKind
from trepid.spelling import did_you_mean
from trepid.types import NonNegative, Positive, PositiveShare

PIPELINES = CONFIG_DIR / "pipelines.yaml"
ORDER = {name: number for number, name in enumerate(KINDS)} | {"prepare": 0, "warp": 0, "region": 0}
ONCE = ("model", "state", "steer", "rule")
STEERING = ("steer", "rule")  # a pipeline has at most one of them
NEEDED = ("features", "model", "state")


class RecipeEntry(Settings):
    """One pipeline as it stands in the file."""

    source: Annotated[str, Field(min_length=1)]
    description: Annotated[str, Field(min_length=1)]
    trust: PositiveShare = 1.0  # greatest confidence, from the benchmark
    width_m: Positive = 3.4  # of its lanes; between lines 2.7 to 3.75 m
    width_sigma_m: Positive = 0.6
    # Ahead of the axle: the way straight on to there lies in a plausible lane. Absent: 8 m, less for a low camera.
    inside_m: NonNegative | None = None
    stages: Annotated[tuple[str | dict[str, dict[str, Any] | None], ...], Field(min_length=1)]


@dataclass(frozen=True)
class Stage:
    """One stage of a pipeline with its settings."""

    name: str
    kind: str
    entry: Callable[..., Any]
    settings: Mapping[str, Any]

    def bind(self) -> Callable[..., Any]:
        """The callable for every frame; a stage with memory begins without any."""
        if not inspect.isclass(self.entry):
            return partial(self.entry, **self.settings)
        step: Callable[..., Any] = self.entry(**self.settings).step  # type: ignore[attr-defined]
        return step


@dataclass(frozen=True)
class PipelineRecipe:
    """A pipeline with its description, its source and its stages."""

    name: str
    source: str
    description: str
    trust: float
    width_m: float
    width_sigma_m: float
    inside_m: float | None
    stages: tuple[Stage, ...]

    @property
    def kind(self) -> EstimateKind:
        """The kind of its estimates."""
        return EstimateKind.ANGLE if self.of("rule") else EstimateKind.LANE

    def version(self) -> str:
        """Its numbers and the settings of its stages, as text."""
        settings = [(stage.name, sorted(stage.settings.items())) for stage in self.stages]
        return repr((self.trust, self.width_m, self.width_sigma_m, self.inside_m, settings))

    def of(self, *kinds: str) -> tuple[Stage, ...]:
        """Its stages of ``kinds``, in order."""
        return tuple(stage for stage in self.stages if stage.kind in kinds)


def recipes(path: Path = PIPELINES) -> dict[str, PipelineRecipe]:
    """All pipelines of the file by name. Raises InputError with file:line:column."""
    return _recipes(path, *texts(path))


@lru_cache(maxsize=8)  # by content, as trepid.config: reading YAML is slow
def _recipes(path: Path, *_: str) -> dict[str, PipelineRecipe]:
    data = read(path)
    return {str(name): _recipe(str(name), data, path) for name in data}


def _recipe(name: str, data: CommentedMap, path: Path) -> PipelineRecipe:
    if not isinstance(data[name], CommentedMap):
        raise InputError(fault_line([name], "expected source, description and stages", data, path))
    written = parse(data[name], RecipeEntry, source=path)
    stages = tuple(_stage(name, number, data, path) for number in range(len(written.stages)))
    recipe = PipelineRecipe(**{**dict(written), "name": name, "stages": stages})
    problem = _misfit(recipe)
    if problem:
        raise InputError(fault_line([name, "stages", *problem[0]], problem[1], data, path))
    return recipe


def _stage(pipeline: str, number: int, data: CommentedMap, path: Path) -> Stage:
    """Stage ``number``: a name, or one name with a mapping of settings."""
    place: list[str | int] = [pipeline, "stages", number]
    item = data[pipeline]["stages"][number]
    if isinstance(item, CommentedMap) and len(item) != 1:
        raise InputError(fault_line(place, f"expected one stage, got {len(item)}", data, path))
    name = next(iter(item)) if isinstance(item, CommentedMap) else item
    kind = next((kind for kind, table in KINDS.items() if name in table), None)
    if kind is None:
        known = [stage for table in KINDS.values() for stage in table]
        problem = f"no stage {str(name)!r}; {did_you_mean(str(name), known)}"
        raise InputError(fault_line(place, problem, data, path))
    entry = KINDS[kind][name]
    given = item[name] if isinstance(item, CommentedMap) else None
    settings = settings_of(entry)
    read_in = parse(given, settings, source=path) if given is not None else settings()
    return Stage(str(name), kind, entry, dict(read_in))


@cache
def settings_of(entry: Callable[..., Any]) -> type[Settings]:
    """The settings of a stage: its keyword-only parameters, or those of its constructor, with their limits."""
    function = entry.__init__ if inspect.isclass(entry) else entry
    hints = get_type_hints(function, include_extras=True)
    fields: dict[str, Any] = {
        name: (hints[name], ... if parameter.default is parameter.empty else parameter.default)
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    }
    return create_model(entry.__name__, __base__=Settings, **fields)


def _misfit(recipe: PipelineRecipe) -> tuple[list[int], str] | None:
    """The place below ``stages`` and the text of an error in the order or number of stages; None without one."""
    kinds = [stage.kind for stage in recipe.stages]
    for number, (before, after) in enumerate(pairwise(kinds), start=1):
        if ORDER[after] < ORDER[before]:
            return [number], f"{after} {recipe.stages[number].name!r} must come before {before}"
        if after in ONCE and after in kinds[:number]:
            return [number], f"a second {after}"
        if before in STEERING and after in STEERING:
            return [number], f"a {after} beside a {before}: one of them steers"
    missing = [kind for kind in NEEDED if kind not in kinds]
    return ([], f"no stage of kind {', '.join(missing)}") if missing else None
