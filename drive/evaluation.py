"""The result of a live drive as a row of ``drive --json``."""

from typing import Any

from drive.course import NOT_DRIVEN, Course, Verdict, why_not_driven
from drive.log import DriveLog
from trepid.processes.launch import Fleet


def evaluate(
    log: DriveLog,
    fleet: Fleet,
    course: Course,
    *,
    seed: int,
    elapsed_s: float,
    problems: list[str],
    notes: list[str],
    end: str = "",
) -> dict[str, Any]:
    """The row of a drive of ``course`` for ``elapsed_s`` [s], by the judge of ``log``.

    Fields that need a true lane are None where there is none. Each of ``problems`` fails the drive; ``notes`` do
    not. ``end``: why it ended.
    """
    verdict = log.judge.verdict(problems, elapsed_s=elapsed_s)
    row = {"scenario": course.scenario, "seed": seed} | _judge(log, verdict, notes)
    return row | {"end": end} | _processes(log, fleet) if verdict.scores else row


def closing_words(row: dict[str, Any]) -> str:
    """Why a drive ended, and its verdict with the reasons, in a sentence."""
    said = row["reasons"] or (row["notes"][-1:] if row["status"] == NOT_DRIVEN else [])
    end = row.get("end", "")
    verdict = f"{row['status']}: {'; '.join(said)}" if said else row["status"]
    return verdict if not end or end in said else f"{end}; {verdict}"


def _judge(log: DriveLog, verdict: Verdict, notes: list[str]) -> dict[str, Any]:
    """The judgement; of a car that never drove a note says what it waited for."""
    notes = [*verdict.notes, *log.limiter_stops, *notes]
    if not verdict.driven and verdict.scores:
        notes = [
            *notes,
            why_not_driven(log.waits_for),
        ]
    return {"status": verdict.status, "reasons": verdict.reasons, "notes": notes, **verdict.scores}


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
                "malformed": log.malformed_count(name),
            }
            for name, child in fleet.children.items()
        },
        "latency_ms": log.times.latency_ms(),
        "stages_ms": log.times.stages_ms(),
    }
