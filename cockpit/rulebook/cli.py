"""``trepid fear``: check, show and explain rule files."""

import json
import math
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from cockpit.rulebook.explanation import check_name, explanation
from cockpit.rulebook.fcl_export import fcl
from cockpit.rulebook.fcl_read import parse_fcl
from cockpit.rulebook.figure import sets_figure, surface_figure
from cockpit.rulebook.show import show_rules, show_surface
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from supervisor.rules.rule_file import RuleFile, rule_schema
from supervisor.rules.verify import place, verify
from supervisor.situation.features import wrong_units
from trepid.config import CONFIG_DIR, InputError, fault_line, load, read, read_text
from trepid.images.figure_style import save

if TYPE_CHECKING:
    from supervisor.rules.scikit import Agreement

app = typer.Typer(no_args_is_help=True)

RuleFileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Rule file, e.g. config/fear.yaml.")]
COMPARED_POINTS = 40
SHOWN_ASSUMED = 4
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON only.")]


@app.command()
def schema() -> None:
    """Print the JSON schema of rule files, for editors."""
    print(rule_schema(), end="")


@app.command()
def export(file: Annotated[Path, typer.Argument(metavar="F.yaml", help="Rule file.")]) -> None:
    """Print the rules as IEC 61131-7 Fuzzy Control Language (FCL)."""
    print(fcl(FearRules.load(file)), end="")


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(metavar="F.fcl", help="Fuzzy Control Language.")],
    like: Annotated[
        Path,
        typer.Option(
            metavar="F.yaml", help="Rule file with the actions and hysteresis that FCL does not state."
        ),
    ] = CONFIG_DIR / "fear.yaml",
) -> None:
    """Print a rule file with the rules of an FCL function block."""
    rules = parse_fcl(read_text(file, windows=True), source=file, like=load(like, RuleFile))
    yaml = YAML()
    yaml.width = 10_000  # a rule stays on its line
    yaml.indent(mapping=2, sequence=4, offset=2)
    empty = {name for name in ("causes", "without") if not getattr(rules, name)}
    yaml.dump(_plain(rules.model_dump(mode="json", exclude=empty, exclude_none=True)), sys.stdout)


def _plain(data: Any) -> Any:
    """Lists of numbers on one line."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list) and data and not isinstance(data[0], str):
        row = CommentedSeq(data)
        row.fa.set_flow_style()
        return row
    return data


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Rule files.")],
    against_skfuzzy: Annotated[
        bool,
        typer.Option(
            "--against-skfuzzy", help="Compare fear with scikit-fuzzy's control system; takes a minute."
        ),
    ] = False,
    points: Annotated[
        int, typer.Option(metavar="N", min=2, help="Number of points of that comparison.")
    ] = COMPARED_POINTS,
    as_json: JsonOption = False,
) -> None:
    """Check that a rule fires at every point, that fear is monotone, and that it reaches 0 and 1. Exit 1 if not."""
    passed = [_check(file, points if against_skfuzzy else 0, as_json=as_json) for file in files]
    if not all(passed):
        raise typer.Exit(1)


def _check(file: Path, compared: int, *, as_json: bool) -> bool:
    """Print the result of :func:`verify` for one file; False when the file has problems."""
    rules = FearRules.load(file)
    verdict = verify(rules)
    for name, fault in wrong_units({name: spec.unit for name, spec in rules.inputs.items()}):
        raise InputError(fault_line(("inputs", name, "unit"), fault, read(file), file))
    agreement = _agreement(rules, compared) if compared else None
    if as_json:
        found = {"problems": verdict.problems, "notes": verdict.notes, "lipschitz": verdict.slopes}
        size = {"method": rules.file.method, "inputs": len(rules.inputs), "rules": len(rules.rules)}
        errors = {name: spec.errors for name, spec in rules.inputs.items() if spec.errors}
        peer = {"skfuzzy": agreement._asdict()} if agreement else {}
        typer.echo(json.dumps({"file": str(file), **size, **found, "approximation": errors, **peer}))
        return not verdict.problems
    for problem in verdict.problems:
        typer.echo(f"{file}:{place(file, problem, rules)}: {problem}", err=True)
    for note in verdict.notes:
        typer.echo(f"{file}:{place(file, note, rules)}: note: {note}", err=True)
    if not verdict.problems:
        extent = f"{len(rules.inputs)} inputs, {len(rules.rules)} rules"
        typer.echo(f"{file}: {extent}: a rule fires everywhere, monotone, reaches 0 and 1")
        typer.echo("fear changes by at most")
        for name, slope in verdict.slopes.items():
            typer.echo(f"  {slope:8.3g} per {rules.inputs[name].unit} of {name}")
    for name, spec in rules.inputs.items():
        for level, error in spec.errors.items():
            function = getattr(spec.sets, level).function
            typer.echo(f"{name} is {level}: {function} as straight lines, within {error:.2g} of degree")
    if agreement:
        _print_agreement(agreement)
    return not verdict.problems


def _agreement(rules: FearRules, points: int) -> "Agreement":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of NumPy, inside scikit-fuzzy
        from supervisor.rules.scikit import compare  # imports scikit-fuzzy, 0.5 s

        return compare(rules, points=points)


def _print_agreement(found: "Agreement") -> None:
    tau = "undefined" if found.kendall_tau is None else f"{found.kendall_tau:.2f}"
    typer.echo(f"against scikit-fuzzy's control system, {found.points} points:")
    typer.echo(
        f"  greatest difference of fear {found.greatest_difference:.2g}, rank agreement (Kendall) {tau}"
    )
    typer.echo(f"  with the method mamdani: greatest difference {found.greatest_difference_mamdani:.2g}")
    typer.echo(f"  sets: greatest difference of degree {found.greatest_difference_of_degrees:.2g}")


@app.command()
def show(
    file: RuleFileArgument,
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME=VALUE...", help="Inputs of a surface that are not calm; nan: a missing value."
        ),
    ] = None,
    surface: Annotated[
        tuple[str, str] | None, typer.Option(metavar="X Y", help="Show fear over these two inputs instead.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="F.png", help="Draw it instead.")] = None,
) -> None:
    """Show the inputs with their sets, the rules, and the effect of each level of fear; or fear over two inputs."""
    rules = FearRules.load(file)
    if values and surface is None:
        raise InputError(
            f"{values[0]}: values are for --surface X Y; `trepid fear explain` rates values alone"
        )
    point = {**calmest(rules), **_values(values or [], rules)}
    axes = _axes(surface, rules) if surface else None
    if picture is not None:
        save(surface_figure(rules, *axes, point) if axes else sets_figure(rules), picture)
        return
    console = Console(width=None if Console().is_terminal else 120)
    if axes:
        show_surface(rules, *axes, point, console)
    else:
        show_rules(rules, console)


@app.command()
def explain(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A rule file, or the recording of a drive.")],
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME=VALUE...", help="Inputs; nan: a missing value. Inputs that are not given are calm."
        ),
    ] = None,
    calm: Annotated[bool, typer.Option("--calm", hidden=True, help="The default.")] = False,
    at: Annotated[
        float | None, typer.Option(metavar="T", help="Recording: explain the moment at T seconds.")
    ] = None,
    rules_file: Annotated[
        Path | None,
        typer.Option("--rules", metavar="F.yaml", help="Recording: use these rules, not its own."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="F.png", help="Recording: draw the camera image of that moment.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Explain the fear that the rules infer from values, or any moment of a recording.

    Inputs that are not given stand at the calm end of their range. For a recording without --at, every slow-down is
    listed.
    """
    # heavy, with the reader of recordings; a check on the live page starts without it
    from cockpit.logbook.explain_drive import explain_drive, is_recording

    if is_recording(file):
        if values or calm:
            raise InputError(f"{file}: a recording has its own values; give the time with --at")
        if not explain_drive(file, at, rules=rules_file, picture=picture, as_json=as_json):
            raise typer.Exit(1)
        return
    if at is not None or picture is not None or rules_file is not None:
        raise InputError(f"{file}: --at, --rules and --picture are for recordings, and this is no MCAP file")
    rules = FearRules.load(file)
    given = _values(values or [], rules)
    explained = explanation(rules, given)
    if as_json:
        typer.echo(json.dumps(explained))
        return
    summary = f"{explained['mode']}, speed x {explained['speed_factor']:.2f}, because of {explained['cause']}"
    typer.echo(f"fear {explained['fear']:.3f} ({explained['level']}): {summary}")
    for rule in explained["rules"]:
        typer.echo(f"  {rule['strength']:.2f}  {rule['text']}")
    if assumed := explained["assumed_calm"]:
        shown = ", ".join(assumed[:SHOWN_ASSUMED]) + (", ..." if len(assumed) > SHOWN_ASSUMED else "")
        typer.echo(f"assumed calm, because not given: {len(assumed)} of {len(rules.names)} inputs ({shown})")


def _values(texts: list[str], rules: FearRules) -> dict[str, float | None]:
    """name=value texts as numbers. Raises InputError for a name that the file does not define."""
    values: dict[str, float | None] = {}
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals:
            raise InputError(f"{text!r}: expected NAME=VALUE")
        check_name(name, rules, text)
        try:
            value = float(number)
        except ValueError as error:
            raise InputError(f"{text}: expected a number or nan, got {number!r}") from error
        values[name] = value if math.isfinite(value) else None
    return values


def _axes(names: tuple[str, str], rules: FearRules) -> tuple[str, str]:
    for name in names:
        check_name(name, rules, f"--surface {' '.join(names)}")
    if names[0] == names[1]:
        raise InputError(f"--surface {' '.join(names)}: two different inputs are needed")
    return names
