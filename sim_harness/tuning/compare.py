"""Comparison of two rule files on the same cases."""

import difflib
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.table import Table

from sim_harness.sweep.plan import Plan
from sim_harness.sweep.pool import imap
from sim_harness.tuning.score import Fearless, Score, driven_by, fearless, reference, score
from sim_harness.tuning.settings import Costs


def references(rules: Path, planned: Plan, workers: int) -> list[Fearless]:
    """Reference drives of a plan without fear, in its order. Raises what a run raises."""
    with TemporaryDirectory() as folder:
        return list(imap(reference, driven_by(fearless(rules, Path(folder)), planned), workers))


def both(before: Path, after: Path, planned: Plan, costs: Costs, workers: int) -> tuple[Score, Score]:
    """The scores of two rule files on the same cases. Raises RunCrashed."""
    drives = references(before, planned, workers)
    judge = partial(score, planned=planned, references=drives, costs=costs)
    one, other = imap(judge, (before, after), min(workers, 2))
    return one, other


def changes(before: str, after: str, before_name: str, after_name: str) -> str:
    """A unified diff without context lines."""
    lines = difflib.unified_diff(
        before.splitlines(), after.splitlines(), before_name, after_name, n=0, lineterm=""
    )
    return "\n".join(lines)


def score_table(columns: dict[str, Score]) -> Table:
    """A table with one column a score."""
    table = Table("", *columns, box=None)
    for name in ("cost", "runs", "departures", "nuisance_per_km", "speed_loss", "auroc", "mean_speed_mps"):
        values = [getattr(of, name) for of in columns.values()]
        table.add_row(name, *("-" if v is None else f"{v:.4g}" for v in values))
    return table
