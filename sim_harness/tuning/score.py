"""Cost of a rule file: the cost of driving scenarios with it.

    cost = departure·D + nuisance_per_km·N + speed_loss·V + missed_warning·(1 - A)

with D the departures and collisions of the average run, N the slow-downs without a cause per km, V the
relative loss of mean speed on calm roads against drives without fear, A the AUROC of fear and departures in 3 s.
A is computed on the drives without fear, because fear prevents departures: the rules are evaluated on the recorded
inputs of every decision, which needs no run.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sim_harness.judging.fear_scores import fear_auroc
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import Instant
from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.outcome import is_complete, perform
from sim_harness.sweep.plan import Plan, plan
from sim_harness.sweep.pool import imap
from sim_harness.sweep.sweep import in_this_process
from sim_harness.tuning.settings import Costs
from supervisor.rules.inference import FearRules
from trepid.config import editing_yaml, read_text
from trepid.messages import Decision, Mode


class RunCrashed(Exception):
    """A crashed run of a candidate, which therefore has no score."""


@dataclass(frozen=True, slots=True)
class Fearless:
    """A drive in which fear had no consequences."""

    mean_speed_mps: float
    t_s: tuple[float, ...]  # of each decision
    departures: tuple[int, ...]  # up to each decision
    speeds_mps: tuple[float | None, ...]
    inputs: tuple[str, ...]
    values: tuple[tuple[float | None, ...], ...]  # of the inputs, a row for each decision

    def fear_trace(self, rules: FearRules) -> Trace:
        """Fear by ``rules`` at every decision of the drive."""
        fear = [rules.evaluate(dict(zip(self.inputs, row, strict=True))).fear for row in self.values]
        columns = {
            "t_s": self.t_s,
            "departures": self.departures,
            "speed_mps": self.speeds_mps,
            "decision.fear": fear,
        }
        return Trace({name: np.array(column, dtype=np.float64) for name, column in columns.items()}, {})


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Results of driving a plan with one rule file."""

    cost: float
    runs: int
    departures: int  # and collisions
    nuisance_per_km: float
    speed_loss: float  # share; negative: faster than without fear
    auroc: float | None  # None: the drives without fear contain no departures, or only departures
    mean_speed_mps: float


def fearless(rules: Path, folder: Path) -> Path:
    """A copy of a rule file whose fear changes nothing, for reference drives."""
    yaml = editing_yaml()
    data = yaml.load(read_text(rules))
    for action in data["fear"].values():
        action["speed_factor"], action["mode"] = 1.0, Mode.KEEP.value
    path = folder / "fearless.yaml"
    yaml.dump(data, path)
    return path


def reference(case: Case) -> Fearless:
    """Drive ``case``, whose rules have no consequences. Raises what the run raises."""
    seen: list[tuple[float, int, float | None, Decision]] = []

    def witness(now: Instant) -> None:
        if now.decision is not None and now.now_s >= 0 and (not seen or seen[-1][-1] is not now.decision):
            seen.append((now.now_s, now.truth.departures, now.state.speed_mps, now.decision))

    result, _ = perform(case, witness=witness)
    return Fearless(
        mean_speed_mps=result.metrics.mean_speed_mps,
        t_s=tuple(t_s for t_s, _, _, _ in seen),
        departures=tuple(departures for _, departures, _, _ in seen),
        speeds_mps=tuple(speed_mps for _, _, speed_mps, _ in seen),
        inputs=seen[0][-1].inputs if seen else (),
        values=tuple(decision.input_values for *_, decision in seen),
    )


def cases_with_rules(rules: Path, planned: Plan) -> list[Case]:
    """The cases of a plan, in its order, with the rule file ``rules``."""
    changes = {"rules": str(rules)}
    return [replace(case, scenario=case.scenario.model_copy(update=changes)) for case in planned.values()]


def score(rules: Path, planned: Plan, references: list[Fearless], costs: Costs) -> Score:
    """Drive ``planned`` with ``rules``; ``references`` are its drives without fear. Raises RunCrashed."""
    cases = cases_with_rules(rules, planned)
    rows = [outcome.row for _, outcome in in_this_process(plan(cases))]
    for row in rows:
        if not is_complete(row):
            raise RunCrashed(f"{row['scenario']} seed {row['seed']}: {row['reasons'][0]}")
    loaded = FearRules.load(rules)
    parts: dict[str, Any] = {
        "departures": sum(row["departures"] + row["collisions"] for row in rows),
        "nuisance_per_km": _nuisance_per_km(rows),
        "speed_loss": _speed_loss(cases, rows, references),
        "auroc": fear_auroc(*(drive.fear_trace(loaded) for drive in references)),
        "mean_speed_mps": float(np.mean([row["mean_speed_mps"] for row in rows])),
    }
    return Score(cost=_cost(parts, len(rows), costs), runs=len(rows), **parts)


def references(rules: Path, planned: Plan, workers: int) -> list[Fearless]:
    """Reference drives of a plan without fear, in its order. Raises what a run raises."""
    with TemporaryDirectory() as folder:
        return list(imap(reference, cases_with_rules(fearless(rules, Path(folder)), planned), workers))


def both(before: Path, after: Path, planned: Plan, costs: Costs, workers: int) -> tuple[Score, Score]:
    """The scores of two rule files on the same cases. Raises RunCrashed."""
    drives = references(before, planned, workers)
    judge = partial(score, planned=planned, references=drives, costs=costs)
    one, other = imap(judge, (before, after), min(workers, 2))
    return one, other


def _cost(parts: dict[str, Any], runs: int, costs: Costs) -> float:
    missed = 0.0 if parts["auroc"] is None else 1.0 - parts["auroc"]
    return float(
        costs.departure * parts["departures"] / runs
        + costs.nuisance_per_km * parts["nuisance_per_km"]
        + costs.speed_loss * max(parts["speed_loss"], 0.0)
        + costs.missed_warning * missed
    )


def _nuisance_per_km(rows: Iterable[dict[str, Any]]) -> float:
    driven = [row for row in rows if row["nuisance_slowdowns_per_km"] is not None]
    distance_km = sum(row["distance_m"] for row in driven) / 1000.0
    count = sum(row["nuisance_slowdowns_per_km"] * row["distance_m"] / 1000.0 for row in driven)
    return count / distance_km if distance_km > 0 else 0.0


def _speed_loss(cases: list[Case], rows: list[dict[str, Any]], references: list[Fearless]) -> float:
    """Share of the mean speed that fear costs in cases without fault, disturbance or traffic, else in all."""
    calm = [not (c.scenario.faults or c.scenario.disturbances or c.scenario.traffic) for c in cases]
    counted = calm if any(calm) else [True] * len(cases)
    pairs = [
        (row["mean_speed_mps"], drive.mean_speed_mps)
        for row, drive, counts in zip(rows, references, counted, strict=True)
        if counts
    ]
    with_fear, without = (float(np.mean(speeds)) for speeds in zip(*pairs, strict=True))
    return 1.0 - with_fear / without if without > 0 else 0.0
