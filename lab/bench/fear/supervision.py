"""Departures of the supervised car and of unsupervised drivers on the same drives.

Hard drives are random (:mod:`lab.bench.fear.drives`) and driven once by every driver with the real
estimators. The drivers without fear follow the last available lane at full speed. In their drives a supervisor runs
in parallel, so that its fear can be compared with departures that it did not prevent. Clean drives measure the cost
of fear, nuisance slow-downs and loss of speed, relative to the plain average.

A car without fear that has left its lane is put back, and often leaves it again within seconds. These departures
count as one: the first departure, after UNDISTURBED_S without any, must be preceded by fear.

Every drive is one line in ``runs/supervision_<seed>.jsonl``; stored drives are not repeated, so an interrupted
benchmark continues, and more cases extend it.

Drivers without fear follow one estimator, the plain average, the most confident one, or the fused path.
"""

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from lab.bench.fear.drives import SupervisionCase, cases
from sim_harness.judging.fear_scores import afraid, auroc, fear_and_departure
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import Result, build_parts, run
from sim_harness.lockstep.unsupervised import LANE, Choice, Estimates, FollowedLane, UnsupervisedDriver
from sim_harness.sweep.store import Row, stored_rows
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, WORK_DIR, load
from trepid.messages import Decision, SteeringEstimate


class Driver(StrEnum):
    """The followed lane."""

    CV = "cv"
    CNN = "cnn"
    AVERAGE = "average"
    SUREST = "surest"
    FUSED = "fused"  # the supervisor's path without its fear


def choice_of(driver: Driver) -> Choice:
    """The lane that ``driver`` follows from now on."""

    def choice(supervised: Decision, estimates: Estimates) -> FollowedLane | None:
        if driver is Driver.FUSED:
            return None if supervised.path_t_s is None else FollowedLane.of(supervised, supervised.path_t_s)
        seen = {name: e for name, e in estimates.items() if e is not None and e.lateral_offset_m is not None}
        lane = choose_estimate(seen, driver)
        return None if lane is None else FollowedLane.of(lane, lane.t_s)

    return choice


def choose_estimate(seen: Mapping[str, SteeringEstimate], driver: Driver) -> SteeringEstimate | None:
    """The lane that ``driver`` follows, from the estimates with a lane."""
    if driver is Driver.SUREST:
        return max(seen.values(), key=lambda e: e.confidence, default=None)
    if driver is Driver.AVERAGE and seen:
        newest = max(seen.values(), key=lambda e: e.t_s)
        mean: dict[str, Any] = {name: fmean(getattr(e, name) for e in seen.values()) for name in LANE}
        return replace(newest, **mean)
    return seen.get(driver)


CASES = 80
SUPERVISED = "supervised"
AHEAD_S = 2.0
UNDISTURBED_S = 3.0  # since the start or an intervention: an earlier departure belongs to the former one
LOOKING_BACK_S = 5.0
TARGETS = "targets: supervised 0; flagged 95 %; AUROC 0.97; nuisance 1 per 10 km; speed loss 5 %"
FEAR_BINS = np.linspace(0.0, 1.0, 101)


def drivers(case: SupervisionCase, *, supervised_only: bool = False) -> list[str]:
    """Drivers of the case; on clean roads only those that are compared there."""
    if supervised_only:
        return [SUPERVISED]
    return [*([Driver.AVERAGE] if case.clean else Driver), SUPERVISED]


def drive(case: SupervisionCase, driver: Driver | None) -> Result:
    """One drive; driver None: the supervised car."""
    scenario = case.scenario
    parts = build_parts(scenario, seed=case.seed)
    if driver is not None:
        cruise_mps = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).cruise_speed_mps
        speed_mps = scenario.speed_mps or cruise_mps
        watched = UnsupervisedDriver(parts.supervisor, driver, choice_of(driver), cruise_speed_mps=speed_mps)
        parts = replace(parts, supervisor=watched)  # type: ignore[arg-type]
    return run(scenario, seed=case.seed, parts=parts)


def driven_row(task: tuple[SupervisionCase, str]) -> Row:
    """The stored row of a drive: scores, times of warning, and fear with and without departure."""
    case, driver = task
    result = drive(case, None if driver == SUPERVISED else Driver(driver))
    fear, left = fear_and_departure(result.trace)
    return {
        "road": case.scenario.description,
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
    """The time from the first fear of at least medium in the last 5 s to every first departure [s].

    The window ends at the start and at the last intervention, before which the car was elsewhere.
    """
    t_s, warned = trace["t_s"], afraid(trace)
    found = []
    for sample in np.flatnonzero(np.diff(trace["departures"]) > 0) + 1:
        since = trace["interventions"] == trace["interventions"][sample - 1]
        if t_s[sample] - t_s[since][0] < UNDISTURBED_S:
            continue
        since &= (t_s >= t_s[sample] - LOOKING_BACK_S) & (t_s < t_s[sample]) & warned
        found.append(float(t_s[sample] - t_s[since][0]) if since.any() else 0.0)
    return found


def bench_supervision(seed: int, *, quick: bool = False) -> Row:
    """The table of drivers, and the figures of fear; ``quick``: of the supervised car alone."""
    path = WORK_DIR / "runs" / f"supervision_{seed}.jsonl"
    return summary(drive_all(seed, CASES, path, supervised_only=quick))


def drive_all(seed: int, count: int, path: Path, *, supervised_only: bool = False) -> list[Row]:
    """Every drive; stored ones are read from ``path``."""
    tasks = {
        f"{case.key} {name}": (case, str(name))
        for case in cases(seed, count)
        for name in drivers(case, supervised_only=supervised_only)
    }
    return stored_rows(path, driven_row, tasks)


def summary(rows: list[Row]) -> Row:
    """Departures of every driver on the hard drives, and the figures of fear."""
    table: Row = {}
    named = {r["driver"] for r in rows}
    for name in [name for name in (*Driver, SUPERVISED) if name in named]:
        hard = [r for r in rows if r["driver"] == name and not r["clean"]]
        left = sum(r["departures"] for r in hard)
        table[f"{name}: departures"] = (
            f"{left} in {len(hard)} drives, {sum(r['distance_m'] for r in hard) / 1e3:.1f} km"
        )
    fused = [r for r in rows if r["driver"] == Driver.FUSED]
    fearless = [r for r in rows if r["driver"] != SUPERVISED]  # a supervised car acts on its fear
    table["first departures with fear 2 s before, fused path"] = _warned_share(fused)
    table["first departures with fear 2 s before, all drivers"] = _warned_share(rows)
    table["AUROC of fear, fused path"] = _auroc(fused)
    table["AUROC of fear, all fearless drivers"] = _auroc(fearless)
    return table | _cost(rows) | {"": TARGETS}


def _warned_share(rows: list[Row]) -> str | None:
    """The share of first departures with a warning of AHEAD_S; None without departures."""
    warned_s = [w for r in rows for w in r["warnings_s"]]
    if not warned_s:
        return None
    return f"{100 * sum(w >= AHEAD_S for w in warned_s) / len(warned_s):.1f} % of {len(warned_s)}"


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
    cost: Row = {"nuisance slow-downs on clean roads": f"{nuisances:.0f} in {km:.1f} km"}
    if fearless:
        speeds = [a["mean_speed_mps"] / b["mean_speed_mps"] for a, b in zip(ours, fearless, strict=True)]
        cost["loss of mean speed on clean roads"] = f"{100 * (1 - float(np.mean(speeds))):.1f} %"
    return cost
