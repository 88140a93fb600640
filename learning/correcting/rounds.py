"""Rounds of driving alone, labelling and training: DAgger (Ross, Gordon and Bagnell, AISTATS 2011).

Round 0 trains on the data set, or starts with a given network. Every further round adds the corrections of the
drives before it to the data set and trains the network of the round before on all of it. All intermediate files are
in the folder OUT.correct; each is written whole, so that a killed correction continues where it was.
"""

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drive.tally import autonomy_percent
from learning.correcting.alone import check, drive_alone, scenario_for
from learning.correcting.corrections import Drift, build_corrections
from learning.dataset.dataset import CARD, NONE, Dataset
from learning.dataset.join import join_datasets
from learning.training.recipe import Recipe
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import files_of_car
from sim_harness.sweep.store import Row, stored_rows
from trepid.config import InputError, car_folder
from trepid.files.whole import write_whole

SCORES = (
    "interventions",
    "departures",
    "duration_s",
    "distance_m",
    "rms_lateral_error_m",
    "max_lateral_error_m",
)
Report = Callable[[str], None]
Train = Callable[..., dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is to be done."""

    data: Dataset
    model: str
    recipe: Recipe
    scenarios: tuple[str, ...]  # names or files
    changes: Mapping[str, str] = field(default_factory=dict)  # of every scenario
    seeds: tuple[int, ...] = (0,)
    rounds: int
    drift: Drift
    out: Path
    start: Path | None = None  # network of round 0; None: trained on ``data``
    command: str = ""

    @property
    def folder(self) -> Path:
        """The folder of the intermediate files."""
        return self.out.with_name(f"{self.out.name}.correct")

    def network(self, number: int) -> Path:
        """The network of a round."""
        return self.folder / f"round-{number}" / self.out.name

    def identity(self) -> str:
        """Hash of all that decides about a round, but not of the number of rounds."""
        scenarios = [load_scenario(name, self.changes).model_dump_json() for name in self.scenarios]
        start = _sha256(self.start) if self.start else ""
        parts = [self.data.sha256, self.model, self.recipe.model_dump_json(), *scenarios]
        parts += [repr(self.seeds), repr(self.drift), start]
        car = car_folder()
        parts += [f"{one.name} {_sha256(one)}" for one in (files_of_car(car) if car else [])]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def correct(plan: Plan, train: Train, *, resume: bool, jobs: int, report: Report) -> list[Row]:
    """Do the rounds and write the best network to ``plan.out``; the scores of every round. Raises InputError.

    ``train`` is :func:`learning.training.run.run`. The best network has the fewest interventions, then the smallest
    lateral error.
    """
    names = [check(source, plan.out.stem, plan.changes).name for source in plan.scenarios]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two of the scenarios are called {twice[0]}: give one of them another name")
    _claim(plan, resume=resume)
    rows: list[Row] = []
    added: list[Dataset] = []
    for number in range(plan.rounds + 1):
        began_s = time.monotonic()
        _make_network(plan, number, added, train, report)
        drives = _drives(plan, number)
        rows.append(
            {
                "round": number,
                "corrections": sum(map(_labelled_count, added)),
                **_drive_all(plan, drives, jobs),
            }
        )
        report(f"round {number} of {plan.rounds}: {_sentence(rows[-1])}")
        if number == plan.rounds:
            break
        found = _corrections(plan, number, [path for _, _, path in drives.values()])
        if found is None:
            report(f"round {number}: nothing drifts: no further round")
            break
        added.append(found)
        left_min = (plan.rounds - number) * (time.monotonic() - began_s) / 60
        report(f"round {number}: {_labelled_count(found)} corrections; about {left_min:.1f} min left")
    best = min(rows, key=lambda row: (row["interventions"], row["rms_lateral_error_m"]))
    _keep(plan, rows, best["round"])
    return rows


def _claim(plan: Plan, *, resume: bool) -> None:
    """Begin or continue the folder. Raises InputError for that of another correction, or without ``resume``."""
    path, identity = plan.folder / "identity", plan.identity()
    if path.is_file():
        if not resume:
            raise InputError(f"{plan.folder}: a correction has begun here: --resume continues it")
        if path.read_text(encoding="utf-8") != identity:
            raise InputError(
                f"{plan.folder}: of other data, network, recipe, car or drives; remove it, or name another --out"
            )
        return
    if plan.out.exists():
        raise InputError(
            f"{plan.out}: is there, and would be overwritten at the end: name another --out; --start {plan.out}"
            " begins with it"
        )
    plan.folder.mkdir(parents=True, exist_ok=True)
    write_whole(path, identity.encode())


def _make_network(plan: Plan, number: int, added: list[Dataset], train: Train, report: Report) -> None:
    """Train the network of a round, unless it is there."""
    out = plan.network(number)
    done = out.with_suffix(".json")
    if done.is_file():
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    if number == 0 and plan.start is not None:
        from learning.training.start import copy_start  # here: a process that drives loads no torch

        copy_start(plan.start, out)
        write_whole(done, b"{}")
        return
    data = join_datasets(out.parent / "data", plan.data, added, command=plan.command) if added else plan.data
    report(f"round {number}: training on {len(data.rows('train'))} frames")
    start = plan.network(number - 1) if number else None
    found = train(
        data,
        plan.model,
        out,
        plan.recipe,
        resume=True,
        command=plan.command,
        report=report,
        start=start,
    )
    write_whole(done, json.dumps(found["scores"]).encode())


def _drives(plan: Plan, number: int) -> dict[str, tuple[Scenario, int, Path]]:
    """The drives of a round: key -> scenario, seed, recording."""
    network = plan.network(number)
    drives = {}
    for source in plan.scenarios:
        scenario = scenario_for(source, network, plan.changes)
        for seed in plan.seeds:
            path = network.parent / f"r{number}_{scenario.name}_{seed}.mcap"
            drives[f"{number} {scenario.name} {seed}"] = (scenario, seed, path)
    return drives


def _drive_all(plan: Plan, drives: Mapping[str, tuple[Scenario, int, Path]], jobs: int) -> Row:
    """The scores of all drives together; those that were driven before are not repeated."""
    codes = dict.fromkeys(drives, "")  # a resumed correction keeps its drives, whatever code continues it
    rows = stored_rows(plan.folder / "drives.jsonl", drive, drives, codes=codes, jobs=min(jobs, len(drives)))
    duration_s = sum(row["duration_s"] for row in rows)
    interventions = sum(row["interventions"] for row in rows)
    squared_m2 = sum(row["rms_lateral_error_m"] ** 2 * row["duration_s"] for row in rows) / duration_s
    return {
        "interventions": interventions,
        "departures": sum(row["departures"] for row in rows),
        "autonomy_percent": autonomy_percent(interventions, duration_s),
        "rms_lateral_error_m": math.sqrt(squared_m2),
        "max_lateral_error_m": max(row["max_lateral_error_m"] for row in rows),
        "distance_m": sum(row["distance_m"] for row in rows),
    }


def drive(task: tuple[Scenario, int, Path]) -> Row:
    """Drive alone and record; the scores of the drive."""
    scenario, seed, path = task
    partial = path.with_suffix(".partial")
    partial.unlink(missing_ok=True)
    row = drive_alone(scenario, seed=seed, record=partial).row()
    partial.replace(path)
    return {name: row[name] for name in SCORES}


def _corrections(plan: Plan, number: int, drives: list[Path]) -> Dataset | None:
    """The corrections of the drives of a round; None where nothing drifts."""
    folder = plan.network(number).parent / "corrections"
    nothing = folder.with_suffix(".none")
    if nothing.is_file():
        return None
    if (folder / CARD).is_file():
        return Dataset.open(folder)
    found = build_corrections(folder, drives, plan.out.stem, plan.drift)
    if found is None:
        write_whole(nothing, b"")
    return found


def _labelled_count(data: Dataset) -> int:
    return int((data.rows()["split"] != NONE).sum())


def _sentence(row: Row) -> str:
    way_m = row["distance_m"]
    way = f"{way_m:.0f} m" if way_m < 1e3 else f"{way_m / 1e3:.2f} km"
    return (
        f"{row['interventions']} interventions, {row['rms_lateral_error_m']:.3f} m rms and"
        f" {row['max_lateral_error_m']:.2f} m at most beside the centre, in {way}"
    )


def _keep(plan: Plan, rows: list[Row], best: int) -> None:
    """Copy network and card of the best round, and add the rounds to the card."""
    network, card = plan.network(best), plan.network(best).with_suffix(".md")
    lines = [f"| {row['round']} | {row['corrections']} | {_sentence(row)} |" for row in rows]
    head = [
        f"## Correction: round {best} of {len(rows) - 1}",
        f"`{plan.command}`",
        f"Alone on {', '.join(plan.scenarios)}, which the corrections come from:",
    ]
    table = ["| round | added frames | drives |", "|---|---:|---|", *lines]
    text = card.read_text(encoding="utf-8") if card.is_file() else f"# {plan.out.stem}\n"
    described = "\n".join([text, *(f"{line}\n" for line in head), *table]) + "\n"
    write_whole(plan.out.with_suffix(".md"), described.encode())
    write_whole(plan.out, network.read_bytes())


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
