"""The result of a live drive as a row of ``drive --json``."""

from dataclasses import asdict
from typing import Any

from drive.log import DriveLog
from sim_harness.judging.conditions.expect import judge
from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import Trace
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.scenario import Scenario
from trepid.processes.launch import Fleet

DRIVEN_M = 0.5  # a car that went less far did not drive


def evaluated(
    log: DriveLog,
    fleet: Fleet,
    scenario: Scenario | None,
    *,
    seed: int,
    elapsed_s: float,
    problems: list[str],
    notes: list[str],
) -> dict[str, Any]:
    """The row of a drive of ``elapsed_s`` [s].

    A drive of ``scenario`` is judged by its conditions; a drive of a real car (None) has no true lane, and fields
    that need it are None. Each of ``problems`` fails the drive; ``notes`` do not.
    """
    row: dict[str, Any] = {"scenario": scenario.name if scenario else None, "seed": seed}
    if scenario is None:
        scores = log.tally.row() | {"realtime_factor": None, "trace_sha256": None}
        return row | _judged(log, problems, notes, scores) | _processes(log, fleet)
    trace = _trace(log, scenario)
    if len(trace) < 2:
        return row | _judged(log, problems or ["no samples were recorded"], notes, {})
    metrics = measure(trace)
    scores = asdict(metrics) | {
        "realtime_factor": round(metrics.duration_s / elapsed_s, 3),
        "trace_sha256": trace.sha256,
    }
    reasons = [*problems, *judge(scenario.expect, metrics, trace)]
    return row | _judged(log, reasons, notes, scores) | _processes(log, fleet)


def _judged(log: DriveLog, reasons: list[str], notes: list[str], scores: dict[str, Any]) -> dict[str, Any]:
    """The judgement; of a car that never drove a note says what it waited for."""
    status = "failed" if reasons else "passed"
    if log.waits_for and (scores.get("distance_m") or 0.0) < DRIVEN_M:
        notes = [*notes, f"the car did not drive: {log.waits_for}"]
    return {"status": status, "reasons": list(reasons), "notes": notes, **scores}


def _processes(log: DriveLog, fleet: Fleet) -> dict[str, Any]:
    """Final speed, what the car waits for, processes and latencies."""
    return {
        "final_speed_mps": log.state.speed_mps if log.state else None,
        "waits_for": log.waits_for,
        "processes": {
            name: {
                "pid": child.popen.pid,
                "restarts": child.restarts,
                **log.loads.of(name),
                "malformed": log.malformed(name),
            }
            for name, child in fleet.children.items()
        },
        "latency_ms": log.times.latency_ms(),
        "stages_ms": log.times.stages_ms(),
    }


def _trace(log: DriveLog, scenario: Scenario) -> Trace:
    """The drive so far, with its events."""
    trace = log.trace()
    return with_events(trace, scenario, scenario.build_road(), log.manoeuvres()) if len(trace) else trace
