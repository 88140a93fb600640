"""What is written beside the weights: the model card, and the learning curve as JSON Lines and as a picture."""

import json
import math
from pathlib import Path
from typing import Any

from learning.training.loop import Progress
from learning.training.recipe import Recipe
from trepid.config import InputError
from trepid.files.whole import replacing, write_whole

FIRST = ", the first weights: no epoch improved on them"
MARK = "written by Trepid"
LIMITS = """\
- The network repeats what the drivers of these frames did on these routes in this light. Lanes, other vehicles and
  speed are no inputs.
- Angles are those of a kinematic vehicle with the wheel of the data set; another car needs its own lock and camera.
- The interval and the border of `unlike` come from the validation frames, which also chose the best epoch; frames
  that follow each other are alike. On other routes both can be too narrow.
- A driver of a car runs it beside another estimator and under the supervisor, never alone."""


def check_card(path: Path) -> None:
    """Raise InputError where ``path`` is a file that is no model card."""
    if path.exists() and not (path.is_file() and MARK in path.read_text(encoding="utf-8", errors="replace")):
        raise InputError(
            f"{path}: is there, and is no model card of Trepid: it is not overwritten; name another --out"
        )


def write_curve(progress: Progress, folder: Path) -> None:
    """``curve.jsonl`` and ``curve.png`` in ``folder``: loss and validation error of every epoch."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    text = "".join(json.dumps(point) + "\n" for point in progress.curve)
    write_whole(folder / "curve.jsonl", text.encode())
    figure = Figure(figsize=(6, 3.5), layout="constrained")
    FigureCanvasAgg(figure)
    left = figure.add_subplot()
    right = left.twinx()
    epochs = [point["epoch"] for point in progress.curve]
    left.plot(epochs, [point["loss"] for point in progress.curve], color="tab:gray", label="loss")
    errors = [math.degrees(point["validation_mae_rad"]) for point in progress.curve]
    right.plot(epochs, errors, color="tab:blue")
    right.axvline(progress.best_epoch, color="tab:blue", linestyle=":")
    left.set_xlabel("epoch")
    left.set_ylabel("training loss", color="tab:gray")
    right.set_ylabel("mean validation error [°]", color="tab:blue")
    with replacing(folder / "curve.png") as fresh:
        figure.savefig(fresh, format="png", dpi=110)


def write_card(
    path: Path, metadata: dict[str, Any], recipe: Recipe, progress: Progress, facts: dict[str, Any]
) -> None:
    """The model card ``path``: what it is, data, command, scores, limits, recipe."""
    scores = "\n".join(f"| {name} | {value:g} |" for name, value in metadata["scores"].items())
    described = "\n".join(f"| {name} | {value} |" for name, value in facts.items())
    findings = "".join(f"- {one['sentence']}\n" for one in metadata["findings"]) or "No findings.\n"
    licences = "\n".join(f"- {line}" for line in metadata["licence"]) or "- none stated"
    text = f"""# {path.stem}: {metadata["model"]}

A network of {metadata["parameters"]} weights from frames of {metadata["width"]} x {metadata["height"]} px to the
road-wheel angle [rad, + = left], {MARK}. First weights of its trunk: {metadata["trunk"]}.

| fact | value |
|---|---|
{described}

## Validation frames

| score | value |
|---|---|
{scores}

|error| ≤ {metadata["interval_90"]:.3f} σ in 90 % of frames like these.
Best epoch {progress.best_epoch} of {progress.epoch}{FIRST if not progress.best_epoch else ""}.

## What was learned

{findings}
{metadata["conclusion"]}

## Licences of the data

{licences}

Weights are made from these data: give them away only where the licences of the data permit it.

## Limits

{LIMITS}

## Recipe

```json
{recipe.model_dump_json(indent=1)}
```
"""
    write_whole(path, text.encode())
