"""``trepid fear tune``: search for a better rule file over scenarios."""

import difflib
import json
import re
from collections.abc import Iterable
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from sim_harness.scenarios.sampling import Method, fresh_seed
from sim_harness.sweep.plan import Plan, by_sampling, plan, select
from sim_harness.tuning.numbers import NumberedText
from sim_harness.tuning.settings import Costs, Span, TuneSettings, parse_vary
from trepid.config import CONFIG_DIR, INTERRUPTED, InputError, load, parse_overrides
from trepid.loudness import note
from trepid.options import Car, Changes

if TYPE_CHECKING:
    from sim_harness.tuning.rule_study import RuleTask
    from sim_harness.tuning.score import Score

SETTINGS = CONFIG_DIR / "tune.yaml"
CANDIDATE = re.compile(r"^\S*candidate\.yaml:")  # the file of a candidate, which is gone
NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def tune(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The rule file to start from.")],
    scenarios: Annotated[
        list[str] | None, typer.Option(metavar="S", help="Tune over this scenario; may be repeated.")
    ] = None,
    unseen: Annotated[
        list[str] | None, typer.Option(metavar="S", help="Evaluate on this scenario too; may be repeated.")
    ] = None,
    cases: Annotated[int | None, typer.Option(min=1, help="Number of random cases of each scenario.")] = None,
    changes: Changes = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW..HIGH", help="Tune this number of the file; may be repeated."),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(
            min=1, help="Total number of trials, those of earlier runs with the same storage included."
        ),
    ] = 50,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    storage: Annotated[
        str | None,
        typer.Option(metavar="URL|F.journal", help="Storage of the trials; default: next to --out."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cases to tune over and of the search.")] = 0,
    unseen_seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the cases to evaluate on; default: random, printed.")
    ] = None,
    sampler: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="What proposes: tpe, random, cma-es, bat, bat-harmony, pso, de, ga."
        ),
    ] = "tpe",
    settings: Annotated[Path, typer.Option(help="Parameters to tune and costs.")] = SETTINGS,
    out: Annotated[
        Path | None, typer.Option(metavar="NEW.yaml", help="The new rule file; default: FILE with _tuned.")
    ] = None,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> int:
    """Optimise numbers of a rule file over scenarios and evaluate the result on other cases.

    The same command continues after an interruption; several commands may share a storage. Exit code 1 when no
    better file was found, or when it is not better on the other cases.
    """
    if find_spec("optuna") is None:
        raise InputError("trepid fear tune needs Optuna: pip install 'trepid[tune]'")
    from sim_harness.tuning.study import check_sampler

    check_sampler(sampler)
    given = load(settings, TuneSettings)
    target = out or file.with_name(f"{file.stem}_tuned.yaml")
    check_target(target)
    names = scenarios or list(given.scenarios)
    held_out = unseen if unseen is not None else [] if scenarios else list(given.unseen)
    fresh = fresh_seed() if unseen_seed is None else unseen_seed
    parameters = parse_vary(vary) if vary else dict(given.parameters)
    check_start(file, parameters)
    draw = partial(draw_cases, parse_overrides(changes or []), cases or given.cases)
    seen, judged = draw(names, seed), draw([*names, *held_out], fresh)
    if set(seen) & set(judged):
        raise InputError(
            f"--unseen-seed {fresh} gives cases of the tuning; choose another seed, or scenarios with ranges"
        )
    trial_storage = storage or str(target.with_suffix(".journal"))
    try:
        task = _task(file, parameters, seen, given.costs, trial_storage, trials, seed, workers, sampler)
        return _tune(task, target, judged, fresh, workers, as_json=as_json)
    except KeyboardInterrupt:
        say("interrupted: finished trials are stored; the same command continues")
        return INTERRUPTED


def check_target(target: Path) -> None:
    """Raise InputError unless ``target`` can become a new file."""
    if target.exists():
        raise InputError(f"{target}: exists already; name another file with --out")
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}")


def check_start(file: Path, parameters: dict[str, Span]) -> None:
    """Raise InputError unless ``file`` passes its check and its numbers lie within their spans."""
    from supervisor.rules.inference import FearRules
    from supervisor.rules.verify import verify

    problems = verify(FearRules.load(file)).problems
    if problems:
        raise InputError(f"{file}: must pass its check before it is tuned: {problems[0]}")
    text = NumberedText(file)
    for name, span in parameters.items():
        value = text.value(name)
        if not span.low <= value <= span.high:
            raise InputError(f"{file}: {name} is {value:g}, outside {span.low:g}..{span.high:g}, its span")
    text.change_numbers({name: text.value(name) for name in parameters})


def draw_cases(overrides: dict[str, str], count: int, names: list[str], seed: int) -> Plan:
    """``count`` cases of each scenario. Raises InputError."""
    selection = select(names, [], overrides)
    return plan(by_sampling(selection.scenarios, Method.RANDOM, count, seed=seed))


def _task(
    rules: Path,
    parameters: dict[str, Span],
    seen: Plan,
    costs: Costs,
    storage: str,
    trials: int,
    seed: int,
    workers: int,
    sampler: str,
) -> "RuleTask":
    """The task of the search, after the drives without fear to which it compares."""
    from sim_harness.tuning.rule_study import RuleTask
    from sim_harness.tuning.score import references

    say(f"{len(seen)} reference drives without fear")
    return RuleTask(
        rules=rules.resolve(),
        parameters=parameters,
        planned=seen,
        references=references(rules, seen, workers),
        costs=costs,
        storage=storage,
        trials=trials,
        seed=seed,
        sampler=sampler,
    )


def _tune(task: "RuleTask", target: Path, judged: Plan, fresh: int, workers: int, *, as_json: bool) -> int:
    from sim_harness.tuning.score import Score, both
    from sim_harness.tuning.study import (
        SCORE,
        START,
        TrialProgress,
        complete,
        cost,
        is_invalid,
        search,
        values_of,
    )

    cases = f"{len(task.planned)} cases a trial"
    say(f"study {task.name} in {task.storage}, {len(task.parameters)} numbers, {cases}")
    trials = search(task, workers, TrialProgress(task.trials, say).report)
    found = complete(trials)
    start = next((trial for trial in found if START in trial.user_attrs), None)
    if start is None:
        raise InputError(
            f"{task.storage}: {task.rules.name} was not driven itself; is another session using the storage?"
        )
    best = min(found, key=cost)
    result: dict[str, Any] = {
        "study": task.name,
        "trials": len(found),
        "invalid": sum(map(is_invalid, trials)),
        "invalid_because": invalid_because(trials),
        "seen": {"before": start.user_attrs[SCORE], "after": best.user_attrs[SCORE]},
        "unseen_seed": fresh,
        "out": None,
    }
    for row in result["invalid_because"]:
        say(f"{row['count']} invalid: {row['first']}")
    if cost(best) >= cost(start):
        print(json.dumps(result) if as_json else f"no better than {task.rules.name} in {len(found)} trials")
        return 1
    text, values = NumberedText(task.rules), values_of(best, task.parameters)
    target.write_text(text.change_numbers(values), encoding="utf-8")
    say(f"wrote {target}; judging it on {len(judged)} unseen cases, seed {fresh}")
    before, after = both(task.rules, target, judged, task.costs, workers)
    diff = difference(text.text, text.change_numbers(values), task.rules.name, target.name)
    result |= {"out": str(target), "values": values, "diff": diff}
    result["unseen"] = {"before": asdict(before), "after": asdict(after)}
    if as_json:
        print(json.dumps(result))
    else:
        seen = {f"{when} (seen)": Score(**score) for when, score in result["seen"].items()}
        print(diff)
        Console().print(_score_table({**seen, "before (unseen)": before, "after (unseen)": after}))
        print("better on unseen cases too" if after.cost < before.cost else "NOT better on unseen cases")
    return 0 if after.cost < before.cost else 1


def invalid_because(trials: Iterable[Any]) -> list[dict[str, Any]]:
    """Count and first example of each reason of the invalid candidates, the most frequent first.

    Messages that differ in numbers only, such as the place in the file and the values, have one reason.
    """
    from sim_harness.tuning.study import INVALID, is_invalid

    examples: dict[str, list[str]] = {}
    for trial in filter(is_invalid, trials):
        message = CANDIDATE.sub("", str(trial.user_attrs[INVALID]))
        examples.setdefault(NUMBER.sub("", message), []).append(message)
    most = sorted(examples.values(), key=len, reverse=True)
    return [{"count": len(messages), "first": messages[0]} for messages in most]


def difference(before: str, after: str, before_name: str, after_name: str) -> str:
    """A unified diff without context lines."""
    texts = before.splitlines(), after.splitlines()
    return "\n".join(difflib.unified_diff(*texts, before_name, after_name, n=0, lineterm=""))


def _score_table(columns: dict[str, "Score"]) -> Table:
    """A table with one column a score."""
    table = Table("", *columns, box=None)
    for name in ("cost", "runs", "departures", "nuisance_per_km", "speed_loss", "auroc", "mean_speed_mps"):
        values = [getattr(of, name) for of in columns.values()]
        table.add_row(name, *("-" if v is None else f"{v:.4g}" for v in values))
    return table


def say(text: str) -> None:
    """Print a line of progress on standard error."""
    note(f"trepid fear tune: {text}")
