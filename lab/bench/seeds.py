"""Scores of the suite with known seeds and with random ones; a difference shows overfitting to the known seeds.

Settings tuned on public seeds can overfit to them. Both scores come from the same scenarios; they should differ by
at most 2 %.
"""

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.scenarios.scenario import Scenario, Tag, list_scenarios
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.plan import PlanStore, by_seeds, plan
from sim_harness.sweep.sweep import sweep, workforce
from trepid.config import WORK_DIR

SCORED = {Tag.NOMINAL, Tag.CURVE, Tag.UNMARKED}
KNOWN_SEEDS = (0, 1, 2, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Scores of a set of runs."""

    runs: int
    pass_rate_percent: float
    mean_max_lateral_error_m: float
    p95_max_lateral_error_m: float

    @property
    def pass_rate_error_points(self) -> float:
        """Standard error of the pass rate, binomial: 100·√(p(1 - p)/n)."""
        share = self.pass_rate_percent / 100.0
        return 100.0 * math.sqrt(share * (1.0 - share) / self.runs)


def score(rows: Iterable[dict[str, Any]]) -> Score:
    """The score of runs, given as rows of ``sim run --json``; a crashed run has failed and has no error.

    Raises ValueError without any that has.
    """
    rows = list(rows)
    errors_m = [row["max_lateral_error_m"] for row in rows if row["max_lateral_error_m"] is not None]
    if not errors_m:
        raise ValueError("no runs to score")
    return Score(
        runs=len(rows),
        pass_rate_percent=100.0 * sum(row["status"] == "passed" for row in rows) / len(rows),
        mean_max_lateral_error_m=float(np.mean(errors_m)),
        p95_max_lateral_error_m=float(np.percentile(errors_m, 95)),
    )


def scored_scenarios() -> list[Scenario]:
    """The shipped scenarios about ordinary driving: tagged nominal, curve or unmarked."""
    return [scenario for scenario in list_scenarios() if SCORED & set(scenario.tags)]


def bench_seeds(seed: int) -> dict[str, Any]:
    """Scores of the shipped scenarios with the known seeds, and with as many random ones from ``seed``.

    Rows are stored in ``runs/seeds_<seed>.jsonl``, from which an interrupted benchmark continues.
    """
    fresh = np.random.default_rng(seed).integers(2**32, size=len(KNOWN_SEEDS)).tolist()
    return compare_seeds(
        scored_scenarios(), KNOWN_SEEDS, fresh, out=WORK_DIR / "runs" / f"seeds_{seed}.jsonl"
    )


def compare_seeds(
    scenarios: Sequence[Scenario], known: Sequence[int], fresh: Sequence[int], *, out: Path
) -> dict[str, Any]:
    """Scores with ``known`` and with ``fresh`` seeds, and their difference; rows are kept in ``out``.

    The difference of the pass rates is in percentage points, with its standard error; that of the errors in percent
    of the errors with the known seeds.
    """
    planned = plan(by_seeds(scenarios, [*known, *fresh]))
    work = workforce(jobs=os.cpu_count() or 1)
    with PlanStore(out, planned, code=fingerprint(), resume=True) as store:
        rows = [outcome.row for _, outcome in sweep(planned, work, store)]
    of_known, of_fresh = (score(row for row in rows if row["seed"] in seeds) for seeds in (known, fresh))
    more = of_fresh.mean_max_lateral_error_m / of_known.mean_max_lateral_error_m - 1.0
    return {
        "scenarios": len(scenarios),
        "known_seeds": list(known),
        "fresh_seeds": list(fresh),
        **{f"known_{name}": round(getattr(of_known, name), 4) for name in Score.__dataclass_fields__},
        **{f"fresh_{name}": round(getattr(of_fresh, name), 4) for name in Score.__dataclass_fields__},
        "pass_rate_difference_points": round(of_fresh.pass_rate_percent - of_known.pass_rate_percent, 2),
        "pass_rate_difference_error_points": round(
            math.hypot(of_known.pass_rate_error_points, of_fresh.pass_rate_error_points), 2
        ),
        "mean_error_difference_percent": round(100.0 * more, 2),
    }
