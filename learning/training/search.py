"""`trepid train --search`: numbers of the recipe by the samplers of `trepid fear tune`, on one shared storage.

A candidate is a recipe; its cost is the mean absolute error of the validation frames [deg of the road wheel] in the
best epoch of its training. A candidate whose loss leaves the finite numbers is invalid. The best recipe is then
trained by its own seed as any other: its weights are those of its candidate, bit by bit on the same machine.
"""

import hashlib
import json
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learning.dataset.dataset import Dataset
from learning.training.recipe import Recipe, load_recipe
from sim_harness.tuning.settings import Span, parse_vary
from sim_harness.tuning.study import (
    START,
    Evaluation,
    Invalid,
    Task,
    TrialProgress,
    complete,
    cost,
    is_invalid,
    search,
    values_of,
)
from trepid.config import CONFIG_DIR, InputError, Settings, load

SETTINGS = "driving_search.yaml"


class RecipeRanges(Settings):
    """The contents of ``config/driving_search.yaml``."""

    parameters: dict[str, Span]  # dotted name of a number of the recipe -> its range


@dataclass(frozen=True, kw_only=True)
class RecipeTask(Task):
    """Numbers of the recipe of the network ``model`` on a data set."""

    data: Path
    data_sha256: str
    model: str
    config: Path | None  # the file that overrides the recipe
    changes: Mapping[str, str]  # of --set
    folder: Path  # where the frames of a worker lie while it trains

    @property
    def name(self) -> str:
        """Name of the study: a hash of network, recipe, parameters and data."""
        spans = {name: span.model_dump() for name, span in self.parameters.items()}
        about = [self.recipe({}).model_dump_json(), spans, self.data_sha256]
        return f"{self.model}-{hashlib.sha256(json.dumps(about).encode()).hexdigest()[:12]}"

    @property
    def place(self) -> Path:
        return self.folder

    def recipe(self, values: Mapping[str, float]) -> Recipe:
        """The recipe with other values. Raises InputError."""
        return load_recipe(self.model, self.config, overrides={**self.changes, **self.words(values)})

    def words(self, values: Mapping[str, float]) -> dict[str, str]:
        """The values as texts of ``--set``."""
        return {
            name: str(int(value)) if self.parameters[name].whole else f"{value:g}"
            for name, value in values.items()
        }

    def start(self) -> dict[str, float]:
        """The values of the recipe; one outside its range, or null, at the nearer end, or at the lower one."""
        found = {}
        for name, span in self.parameters.items():
            value = number(self.recipe({}), name)
            found[name] = span.low if value is None else min(max(value, span.low), span.high)
        return found

    def evaluate(self, values: dict[str, float], folder: Path) -> Evaluation:
        """The validation error of a recipe in its best epoch."""
        from learning.training.loop import Divergence
        from learning.training.run import train_network
        from learning.training.start import checkpoints_of

        out = folder / "candidate.onnx"
        shutil.rmtree(checkpoints_of(out).path.parent / "auto-encoder", ignore_errors=True)
        for path in (checkpoints_of(out).path, checkpoints_of(out).before):
            path.unlink(missing_ok=True)
        data = Dataset.open(self.data)
        if data.sha256 != self.data_sha256:
            raise InputError(f"{self.data}: has changed since the search began")
        try:
            found = train_network(
                data, self.model, out, self.recipe(values), resume=False, report=lambda text: None
            ).progress
        except Divergence as error:
            raise Invalid(str(error)) from error
        return Evaluation(
            math.degrees(found.best_mae_rad),
            {"epoch": found.best_epoch, "epochs": found.epoch, "training_s": found.elapsed_s},
        )


def number(recipe: Recipe, name: str) -> float | None:
    """The number of a recipe at the dotted ``name``; None for null. Raises InputError where there is no number."""
    place: Any = recipe.model_dump()
    for part in name.split("."):
        try:
            place = place[int(part)] if isinstance(place, tuple | list) else place[part]
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise InputError(f"{name}: the recipe has no such field") from error
    if isinstance(place, bool) or not isinstance(place, int | float | None):
        raise InputError(f"{name}: is no number of the recipe, but {place!r}")
    return None if place is None else float(place)


def searched_parameters(vary: list[str], recipe: Recipe) -> dict[str, Span]:
    """The ranges of ``--vary``, or those of the settings. A range of ``--vary`` is whole and logarithmic where the
    settings say so of its field; a field whose number is an integer is whole. Raises InputError.
    """
    known = load(CONFIG_DIR / SETTINGS, RecipeRanges).parameters
    if not vary:
        return known
    found = {}
    for name, span in parse_vary(vary).items():
        value = number(recipe, name)
        like = known.get(name, Span(low=0.0, high=1.0, whole=_is_integer(recipe, name, value)))
        found[name] = Span.model_validate({**like.model_dump(), "low": span.low, "high": span.high})
    return found


def _is_integer(recipe: Recipe, name: str, value: float | None) -> bool:
    """Whether a field of the recipe itself takes integers alone."""
    annotation = str(Recipe.model_fields[name].annotation) if name in Recipe.model_fields else ""
    return value is not None and "int" in annotation and "float" not in annotation


def search_recipe(task: RecipeTask, workers: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Search; the best values and what was found on the way. Raises InputError."""
    task.recipe(task.start())  # names a field that the recipe does not have before any training
    data = Dataset.open(task.data)
    for split in ("train", "validation"):  # what no candidate can train without, too
        data.image(data.labelled_rows(split)[0])
    report(f"study {task.name} in {task.storage}, {len(task.parameters)} numbers")
    trials = search(task, workers, TrialProgress(task.trials, report).report)
    found = complete(trials)
    if not found:
        raise InputError(f"{task.storage}: no candidate could be trained; the first: {_first_reason(trials)}")
    best = min(found, key=cost)
    first = [cost(trial) for trial in found if START in trial.user_attrs]
    return {
        "study": task.name,
        "sampler": task.sampler,
        "trials": len(found),
        "invalid": sum(map(is_invalid, trials)),
        "recipe_mae_deg": first[0] if first else None,
        "best_mae_deg": cost(best),
        "values": task.words(values_of(best, task.parameters)),
    }


def _first_reason(trials: list[Any]) -> str:
    from sim_harness.tuning.study import INVALID

    said = [str(trial.user_attrs[INVALID]) for trial in trials if INVALID in trial.user_attrs]
    return said[0] if said else "no worker finished one"
