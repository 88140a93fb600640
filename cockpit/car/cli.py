"""``trepid doctor``: checks of the machine and of the car before a drive."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from cockpit.car import checks, devices, machine
from cockpit.car.checks import Finding
from trepid.options import Car

CHECKS: tuple[Callable[[], Finding], ...] = (
    checks.packages,
    checks.configuration,
    checks.models,
    checks.people,
    devices.processes,
    devices.camera,
    devices.actuator,
    checks.endpoint,
    machine.clock,
    machine.cores,
    lambda: machine.disk(Path()),
    machine.ring,
    machine.real_time,
)


def doctor(
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per check.")] = False,
) -> int:
    """Check the machine and the car, with a remedy for each fault; exit code 1 when a check fails."""
    healthy = True
    for finding in findings():
        healthy &= finding.ok
        if as_json:
            print(json.dumps(asdict(finding)), flush=True)
        else:
            show(finding)
    return 0 if healthy else 1


def findings() -> Iterator[Finding]:
    """The finding of each check, as soon as it is known; a fault that stops several checks is said by the first."""
    said: set[str] = set()
    for check in CHECKS:
        finding = check()
        if finding.ok or finding.message not in said:
            yield finding
        if not finding.ok:
            said.add(finding.message)


def show(finding: Finding) -> None:
    """Print a finding as a line, and its remedy below it."""
    console = Console(soft_wrap=True, highlight=False, markup=False)
    console.print("ok  " if finding.ok else "FAIL", style="green" if finding.ok else "bold red", end=" ")
    console.print(f"{finding.check:14}{finding.message}")
    if finding.remedy:
        console.print(f"{'':19}-> {finding.remedy}", style="dim" if finding.ok else "yellow")
