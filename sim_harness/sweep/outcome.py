"""The outcome of one case, in any process."""

import ctypes
import time
import traceback
from dataclasses import dataclass, fields
from pathlib import Path

from sim_harness.judging.metrics import FurtherMetrics, Metrics
from sim_harness.lockstep.closed_loop import Result, Witness, run
from sim_harness.report.film import run_filmed
from sim_harness.report.summary import Detail, summarise
from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.store import Row
from trepid.config import InputError

_MALLOC_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only


class ClusterLost(Exception):
    """The connection to the cluster is lost; finished outcomes were yielded before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The row of a case and the data of its page in a report."""

    row: Row
    detail: Detail | None = None  # None: not requested, or no result
    code: str  # fingerprint of the process that ran it
    core_s: float | None = None  # processor time of the process [s]; None: stored before, or crashed


def execute(case: Case, *, detailed: bool = False) -> Outcome:
    """Run a case. An exception becomes the reason of its failure, so that it does not end the sweep.

    Raises InputError for wrong input or configuration, which is no failure of the case.
    """
    try:
        return perform(case, detailed=detailed)[1]
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return crash_outcome(case, f"crashed: {what} ({Path(frame.filename).name}:{frame.lineno})")
    finally:
        if _MALLOC_TRIM is not None:  # glibc otherwise keeps fragments of the arrays of the renderer
            _MALLOC_TRIM(0)


def perform(case: Case, *, detailed: bool = False, witness: Witness | None = None) -> tuple[Result, Outcome]:
    """Run a case; ``detailed`` also for a report. Raises what the run raises."""
    detail, before_s = None, time.process_time()
    if detailed:
        result, film = run_filmed(case.scenario, seed=case.seed, witness=witness)
        detail = summarise(case.scenario, result, film)
    else:
        result = run(case.scenario, seed=case.seed, witness=witness)
    core_s = time.process_time() - before_s
    row = with_parameters(case, result.row())
    return result, Outcome(row=row, detail=detail, code=fingerprint(), core_s=core_s)


def crash_outcome(case: Case, reason: str) -> Outcome:
    """The outcome of a case that has no result: failed, every score absent."""
    row: Row = {
        "scenario": case.scenario.name,
        "seed": case.seed,
        "status": "failed",
        "reasons": [reason],
        **dict.fromkeys(field.name for field in fields(Metrics)),
        "realtime_factor": None,
        "trace_sha256": None,
        "waits_for": "",
        **dict.fromkeys(field.name for field in fields(FurtherMetrics)),
    }
    return Outcome(row=with_parameters(case, row), code=fingerprint())


def is_complete(row: Row) -> bool:
    """False for the row of a crashed case: it has no trace."""
    return row.get("trace_sha256") is not None


def with_parameters(case: Case, row: Row) -> Row:
    """``row`` with the values of a sampled case."""
    return {**row, "parameters": case.parameters} if case.parameters else row
