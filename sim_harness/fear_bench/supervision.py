"""Who keeps the lane: each estimator alone, their plain average, the surest of them, or the supervised car?

Hard drives are drawn by lot (a disturbance, its grade, a bend) and driven once by every driver, each on what the
real estimators see. The drivers without a supervisor know no fear: they drive on the last lane there was, at full
speed. In their drives the supervisor watches, so that its fear can be held against the departures that it did not
prevent. Clean drives give what fear costs: nuisance slow-downs and speed, beside the plain average.

Every drive is one line in ``runs/supervision_<seed>.jsonl``; what is there is not driven again, so a bench that was
stopped goes on, and one with more cases adds to it.
"""

import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.fear_bench.arms import Driver, Watched
from sim_harness.lockstep.closed_loop import Result, build_parts, run
from sim_harness.lockstep.fear_scores import afraid, auroc, fear_and_departure
from sim_harness.lockstep.trace import Trace
from sim_harness.scenarios.scenario import load_scenario
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, ROOT, load

CASES = 20
HARD = (
    "snow",
    "snow_covered",
    "glare",
    "over_exposure",
    "dirt",
    "occlusion",
    "worn_markings",
    "rain",
    "fog",
    "night",
)
CLEAN = ("straight", "s_curve", "twenty_mph", "curve_left_r15")
SUPERVISED = "supervised"
AHEAD_S = 2.0
TARGETS = "targets: supervised 0; flagged 95 %; AUROC 0.97; nuisance 1 per 10 km; speed loss 5 %"
FEAR_BINS = np.linspace(0.0, 1.0, 101)
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One drive to be driven by every driver."""

    name: str
    changes: Mapping[str, str]
    seed: int
    clean: bool

    @property
    def key(self) -> str:
        """What tells this case from every other."""
        return json.dumps([self.name, dict(self.changes), self.seed])


def cases(seed: int, count: int) -> Iterator[Case]:
    """Clean cases first, then ``count`` hard ones; more of them begin with the same."""
    for name in CLEAN:
        yield Case(name, {}, seed % 2**31, clean=True)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        name = str(rng.choice(HARD))
        changes = {}
        if load_scenario(name).disturbances:
            changes["disturbances.0.grade"] = str(rng.integers(2, 6))
            changes["segments.1.curvature_1pm.1"] = changes["segments.2.curvature_1pm"] = str(
                round(float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.025)), 4)
            )
        yield Case(name, changes, int(rng.integers(2**31)), clean=False)


def drivers(case: Case) -> list[str]:
    """Who drives it: everybody, but on clean roads only those who are compared there."""
    return [*([Driver.AVERAGE] if case.clean else Driver), SUPERVISED]


def drive(case: Case, driver: Driver | None) -> Result:
    """One drive; None: by the supervisor."""
    scenario = load_scenario(case.name, case.changes)
    parts = build_parts(scenario, seed=case.seed)
    if driver is not None:
        cruise_mps = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).cruise_speed_mps
        watched = Watched(parts.supervisor, driver, cruise_speed_mps=scenario.speed_mps or cruise_mps)
        parts = replace(parts, supervisor=watched)  # type: ignore[arg-type]
    return run(scenario, seed=case.seed, parts=parts)


def row_of(case: Case, driver: str, result: Result) -> Row:
    """What is kept of a drive: scores, how early each departure was feared, and fear with and without departure."""
    fear, left = fear_and_departure(result.trace)
    return {
        "case": case.key,
        "driver": driver,
        "clean": case.clean,
        "departures": result.metrics.departures,
        "distance_m": result.metrics.distance_m,
        "mean_speed_mps": result.metrics.mean_speed_mps,
        "nuisance_per_km": result.row()["nuisance_slowdowns_per_km"],
        "warnings_s": warnings_s(result.trace),
        "fear_before": np.histogram(fear[left], FEAR_BINS)[0].tolist(),
        "fear_else": np.histogram(fear[~left], FEAR_BINS)[0].tolist(),
    }


def warnings_s(trace: Trace) -> list[float]:
    """For every departure, how long before it fear first was at least medium, looking back 5 s [s].

    Not further back than the start, and the last intervention: before it the car was elsewhere.
    """
    t_s, warned = trace["t_s"], afraid(trace)
    found = []
    for sample in np.flatnonzero(np.diff(trace["departures"]) > 0) + 1:
        since = (t_s >= t_s[sample] - 5.0) & (t_s < t_s[sample]) & warned
        since &= trace["interventions"] == trace["interventions"][sample - 1]
        found.append(float(t_s[sample] - t_s[since][0]) if since.any() else 0.0)
    return found


def bench_supervision(seed: int) -> Row:
    """The table of drivers, and the figures of fear. Raises InputError when a scenario does not load."""
    path = ROOT / "runs" / f"supervision_{seed}.jsonl"
    return summary(list(driven(seed, CASES, path)))


def driven(seed: int, count: int, path: Path) -> Iterator[Row]:
    """Every drive, those that ``path`` holds from there; progress goes to stderr."""
    path.parent.mkdir(exist_ok=True)
    known = (
        {(r["case"], r["driver"]): r for r in map(json.loads, path.read_text().splitlines())}
        if path.exists()
        else {}
    )
    todo = [(case, name) for case in cases(seed, count) for name in drivers(case)]
    left = sum((case.key, str(name)) not in known for case, name in todo)
    began_s, done = time.monotonic(), 0
    for case, name in todo:
        row = known.get((case.key, str(name)))
        if row is None:
            result = drive(case, None if name == SUPERVISED else Driver(name))
            row = row_of(case, str(name), result)
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
            done += 1
            rest_s = (time.monotonic() - began_s) / done * (left - done)
            print(
                f"{case.name} {name}: {row['departures']} departures; {rest_s / 60:.0f} min left",
                file=sys.stderr,
            )
        yield row


def summary(rows: list[Row]) -> Row:
    """Departures of every driver on the hard drives, and the figures of fear."""
    table: Row = {}
    for name in [*Driver, SUPERVISED]:
        hard = [r for r in rows if r["driver"] == name and not r["clean"]]
        left = sum(r["departures"] for r in hard)
        table[f"{name}: departures"] = (
            f"{left} in {len(hard)} drives, {sum(r['distance_m'] for r in hard) / 1e3:.1f} km"
        )
    warned_s = [w for r in rows for w in r["warnings_s"]]
    if warned_s:
        early = sum(w >= AHEAD_S for w in warned_s)
        table["departures feared 2 s ahead"] = f"{100 * early / len(warned_s):.1f} % of {len(warned_s)}"
    return table | {"AUROC of fear": _auroc(rows)} | _cost(rows) | {"": TARGETS}


def _auroc(rows: list[Row]) -> float | None:
    """Of the pooled histograms of fear: each bin is one score."""
    before, others = (np.sum([r[name] for r in rows], axis=0) for name in ("fear_before", "fear_else"))
    if not before.sum() or not others.sum():
        return None
    scores = np.repeat(np.tile(np.arange(len(before)), 2), np.concatenate([before, others])).astype(float)
    found = auroc(scores, np.arange(len(scores)) < before.sum())
    return None if found is None else round(found, 4)


def _cost(rows: list[Row]) -> Row:
    """Nuisance slow-downs and loss of speed on clean roads."""
    clean = {
        str(name): [r for r in rows if r["driver"] == name and r["clean"]]
        for name in (SUPERVISED, Driver.AVERAGE)
    }
    ours, fearless = clean[SUPERVISED], clean[Driver.AVERAGE]
    km = sum(r["distance_m"] for r in ours) / 1e3
    nuisances = sum((r["nuisance_per_km"] or 0.0) * r["distance_m"] / 1e3 for r in ours)
    speeds = [a["mean_speed_mps"] / b["mean_speed_mps"] for a, b in zip(ours, fearless, strict=True)]
    return {
        "nuisance slow-downs on clean roads": f"{nuisances:.0f} in {km:.1f} km",
        "loss of mean speed on clean roads": f"{100 * (1 - float(np.mean(speeds))):.1f} %",
    }
