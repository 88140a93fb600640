"""Recordings of lock-step drives."""

from pathlib import Path

from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import Scenario


def record_drive(
    path: Path, scenario: Scenario, *, seed: int = 0, raw_images: bool = False, trace: Path | None = None
) -> Path:
    """Drive ``scenario`` and record it at ``path``; ``trace``: where its trace is saved too."""
    with recording(path, scenario, raw_images=raw_images) as witness:
        driven = run(scenario, seed=seed, witness=witness)
    if trace is not None:
        driven.trace.save(trace)
    return path
