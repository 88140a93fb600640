"""The live status of a drive in the terminal."""

from collections.abc import Iterable

from rich.console import Group
from rich.table import Table
from rich.text import Text

from sim_harness.live.drive_log import DriveLog
from trepid.messages import Diagnostic, Health
from trepid.processes.launch import Fleet

FEAR_COLOURS = {
    "very_low": "green",
    "low": "green",
    "medium": "yellow",
    "high": "dark_orange",
    "very_high": "red",
}


class Warnings:
    """The warnings and errors of the processes, each returned once until the process reports another state."""

    def __init__(self) -> None:
        self._reported: dict[str, tuple[Health, str]] = {}

    def new(self, beats: Iterable[Diagnostic]) -> list[str]:
        """One line for each process whose newest heartbeat has another warning or error than before."""
        lines = []
        for beat in beats:
            state = beat.health, beat.message
            if beat.health is not Health.OK and state != self._reported.get(beat.process):
                message = " ".join(beat.message.split())
                lines.append(f"process {beat.process}: {beat.health}: {message}")
            self._reported[beat.process] = state
        return lines


def status(log: DriveLog, fleet: Fleet, *, elapsed_s: float) -> Group:
    """Table of the processes with rates and ages, and below it a line about the car and its fear."""
    table = Table(box=None, pad_edge=False)
    for heading in ("process", "pid", "steps/s", "last beat", "cpu %", "restarts", "message"):
        table.add_column(heading, justify="left" if heading in ("process", "message") else "right")
    for name, child in fleet.children.items():
        beat = log.diagnostics.get(name)
        values = dict(beat.values) if beat else {}
        table.add_row(
            name,
            str(child.popen.pid),
            values.get("rate_hz", "-"),
            f"{log.now_s() - beat.t_s:.1f} s" if beat else "-",
            values.get("cpu_percent", "-"),
            str(child.restarts),
            beat.message if beat else "starting",
        )
    return Group(table, driving_line(log, elapsed_s=elapsed_s))


def driving_line(log: DriveLog, *, elapsed_s: float) -> Text:
    """One line: time, place, speed, lateral error, mode, fear and its cause."""
    text = Text(f"t {elapsed_s:6.1f} s")
    truth, state, decision = log.truth, log.state, log.decision
    if truth is not None:
        text.append(f"  at {truth.station_m:6.1f} m ({truth.section})")
        text.append(f"  error {truth.lateral_offset_m:+.2f} m")
    if state is not None and state.speed_mps is not None:
        text.append(f"  speed {state.speed_mps:4.1f} m/s")
    if decision is not None:
        colour = FEAR_COLOURS.get(decision.level, "white")
        text.append(f"  {decision.mode}", style="bold")
        text.append(f"  fear {decision.fear:.2f} {decision.level} ({decision.cause})", style=colour)
    return text
