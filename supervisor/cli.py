"""``trepid fear``: check, show and explain rule files."""

import difflib
import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from supervisor.inference import FearRules
from supervisor.membership import Trapezoid
from supervisor.rules import LEVELS, Input
from supervisor.verify import place, verify
from trepid.config import InputError

app = typer.Typer(no_args_is_help=True)

RuleFileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Rule file, e.g. config/fear.yaml.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON only.")]
PLOT_COLUMNS = 44


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Rule files.")],
    as_json: JsonOption = False,
) -> None:
    """Check that the rules speak everywhere, are monotone, and reach 0 and 1. Exit 1 if not."""
    passed = [_check(file, as_json=as_json) for file in files]
    if not all(passed):
        raise typer.Exit(1)


def _check(file: Path, *, as_json: bool) -> bool:
    """Tell what :func:`verify` finds in one file; whether it may drive."""
    rules = FearRules.load(file)
    verdict = verify(rules)
    if as_json:
        found = {"problems": verdict.problems, "notes": verdict.notes, "lipschitz": verdict.slopes}
        size = {"method": rules.file.method, "inputs": len(rules.inputs), "rules": len(rules.rules)}
        typer.echo(json.dumps({"file": str(file), **size, **found}))
        return not verdict.problems
    for problem in verdict.problems:
        typer.echo(f"{file}:{place(file, problem, rules)}: {problem}", err=True)
    for note in verdict.notes:
        typer.echo(f"{file}:{place(file, note, rules)}: note: {note}", err=True)
    if not verdict.problems:
        extent = f"{len(rules.inputs)} inputs, {len(rules.rules)} rules"
        typer.echo(f"{file}: {extent}: speaks everywhere, monotone, reaches 0 and 1")
        typer.echo("fear changes by at most")
        for name, slope in verdict.slopes.items():
            typer.echo(f"  {slope:8.3g} per {rules.inputs[name].unit} of {name}")
    return not verdict.problems


@app.command()
def show(file: RuleFileArgument) -> None:
    """Show the inputs with their sets, the rules, and what each level of fear does."""
    rules = FearRules.load(file)
    console = Console(width=None if Console().is_terminal else 120)
    for name, spec in rules.inputs.items():
        low, high = spec.range
        risk = "more is worse" if spec.risk == "rising" else "less is worse"
        about = f"[{spec.unit}] {low:g} … {high:g}, {risk}: {spec.meaning}"
        console.print(f"[bold]{name}[/bold] {escape(about)}", highlight=False, soft_wrap=True)
        console.print(_set_table(spec))
    console.print("[bold]rules[/bold]")
    for rule in rules.rules:
        console.print(f"  {escape(rule.text)}", soft_wrap=True)
    console.print(_action_table(rules))


@app.command()
def explain(
    file: RuleFileArgument,
    values: Annotated[
        list[str] | None, typer.Argument(metavar="NAME=VALUE...", help="Inputs; nan: a missing value.")
    ] = None,
    calm: Annotated[
        bool, typer.Option("--calm", help="Inputs that are not given are calm, instead of missing.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Explain how afraid the rules are of these values, and why. Inputs that are not given are missing."""
    rules = FearRules.load(file)
    given = _values(values or [], rules)
    point = {name: given.get(name, spec.calmest if calm else None) for name, spec in rules.inputs.items()}
    explained = explanation(rules, point)
    if as_json:
        typer.echo(json.dumps(explained))
        return
    summary = f"{explained['mode']}, speed x {explained['speed_factor']:.2f}, because of {explained['cause']}"
    typer.echo(f"fear {explained['fear']:.3f} ({explained['level']}): {summary}")
    for fired in explained["rules"]:
        typer.echo(f"  {fired['strength']:.2f}  {fired['text']}")


def explanation(rules: FearRules, values: dict[str, float | None]) -> dict[str, Any]:
    """What ``trepid fear explain --json`` prints. The mode is that of the level, without hysteresis."""
    felt = rules.evaluate(values)
    return {
        "fear": felt.fear,
        "level": felt.level,
        "memberships": rules.memberships(values),
        "rules": [{"text": fired.text, "strength": fired.strength} for fired in felt.rules],
        "cause": felt.cause,
        "speed_factor": rules.speed_factor(felt.fear),
        "mode": rules.mode(felt.fear).value,
        "trust": {name: trust.trust for name, trust in rules.trust(values).items()},
    }


def _values(texts: list[str], rules: FearRules) -> dict[str, float | None]:
    """name=value texts as numbers. Raises InputError for a name that the file does not know."""
    values: dict[str, float | None] = {}
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals:
            raise InputError(f"{text!r}: expected NAME=VALUE")
        if name not in rules.inputs:
            close = difflib.get_close_matches(name, rules.names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(rules.names)}"
            raise InputError(f"{text}: unknown input {name!r}; {hint}")
        try:
            value = float(number)
        except ValueError as error:
            raise InputError(f"{text}: expected a number or nan, got {number!r}") from error
        values[name] = value if math.isfinite(value) else None
    return values


def _set_table(spec: Input) -> Table:
    low, high = spec.range
    table = Table(box=None, show_header=False, padding=(0, 1))
    shown_high = spec.sets.very_high[1] + (spec.sets.very_high[1] - low) * 0.15  # the tail is flat
    for level in LEVELS:
        points = " ".join(f"{x:g}" for x in getattr(spec.sets, level))
        table.add_row(f"  {level}", _curve(spec.sets.trapezoid(level), low, min(high, shown_high)), points)
    return table


def _curve(points: tuple[float, float, float, float], low: float, high: float) -> str:
    """A set as a row of bars."""
    shape, bars = Trapezoid(*points), " ▁▂▃▄▅▆▇█"
    places = [low + (high - low) * i / (PLOT_COLUMNS - 1) for i in range(PLOT_COLUMNS)]
    return "".join(bars[round(8 * shape.membership(x))] for x in places)


def _action_table(rules: FearRules) -> Table:
    table = Table("fear", "at", "speed factor", "mode", box=None)
    for level, action in zip(LEVELS, rules.file.fear.all, strict=True):
        table.add_row(level, f"{action.at:g}", f"{action.speed_factor:g}", action.mode.value)
    return table
