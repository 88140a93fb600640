"""The ``drive`` verb."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from drive.course import PASSED
from trepid.causes import Cause, in_words
from trepid.config import CONFIG_DIR, InputError, car_folder, load, parse_overrides
from trepid.loudness import Loudness, loudness, note, warn
from trepid.messages import Health, Mode
from trepid.options import Car, Changes, Chosen, RawImages

if TYPE_CHECKING:  # heavy; the first line of a drive comes before them
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from drive.log import DriveLog
    from drive.monitor import Show
    from trepid.processes.drive_settings import DriveSettings
    from trepid.processes.launch import Fleet
    from trepid.processes.page_door import PageDoor

SIGN_OF_LIFE_S = 0.3  # without output until then, a line says what the drive does
PLAIN_PERIOD_S = 2.0  # between lines when standard error is no terminal
FEAR_COLOURS = {
    "very_low": "green",
    "low": "green",
    "medium": "yellow",
    "high": "dark_orange",
    "very_high": "red",
}


def drive(
    scenario: Annotated[
        str | None,
        typer.Option(
            help="Scenario name or file; default: that of drive.yaml, and none where the car has no simulator."
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option(min=1.0, help="Stop after this long [s].")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and noise.")] = 0,
    changes: Changes = None,
    chosen: Chosen = None,
    dashboard: Annotated[bool, typer.Option(help="Live status in the terminal.")] = True,
    record: Annotated[Path | None, typer.Option(help="Record every topic to this MCAP file.")] = None,
    raw_images: RawImages = False,
    page: Annotated[
        int | None, typer.Option(min=1, max=65535, metavar="PORT", help="Port of the live page.")
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Serve no live page.")] = False,
    foxglove: Annotated[
        bool,
        typer.Option("--foxglove", help="Serve the topics to Foxglove and Lichtblick, on this machine."),
    ] = False,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> int:
    """Drive with all processes (camera, perception, supervisor, controller, vehicle) over Zenoh.

    The processes are those of processes.yaml. With a simulator among them, or with --scenario, the car is
    simulated. Else the drive lasts until --duration or a signal (Ctrl-C), and the car stops before its end.
    """
    if raw_images and record is None:
        raise InputError("--raw-images needs --record")
    life = threading.Timer(SIGN_OF_LIFE_S, say, [f"reading the configuration {of_car()}".rstrip()])
    life.start()
    try:
        door = _Page(page, no_page, foxglove)
        row = _drive(
            scenario, duration, seed, changes, chosen, dashboard, record, life, door, raw_images=raw_images
        )
    finally:
        life.cancel()
    if as_json:
        print(json.dumps(row))
    else:
        from rich.console import Console

        Console().print(summary(row))
    return 0 if row["status"] == PASSED else 1


class _Page(NamedTuple):
    """What the command line says about the live page, and about Foxglove."""

    port: int | None
    left_out: bool
    foxglove: bool

    def door(self, settings: "DriveSettings") -> "PageDoor | None":
        """Where the page is served; None: nowhere. Raises InputError."""
        from trepid.processes.page_door import page_door

        if self.left_out:
            return None
        return page_door(settings.page_host, self.port or settings.page_port, only=self.port is not None)


def _drive(
    scenario: str | None,
    duration: float | None,
    seed: int,
    changes: list[str] | None,
    chosen: list[str] | None,
    dashboard: bool,
    record: Path | None,
    life: threading.Timer,
    page: "_Page",
    *,
    raw_images: bool,
) -> dict[str, Any]:
    """The row of the drive. ``life`` prints a line after SIGN_OF_LIFE_S; the first line of the drive cancels it."""
    from drive.launcher import drive as drive_course
    from drive.open_road import course_for
    from drive.plan import has_simulator
    from trepid.processes.drive_settings import DriveSettings
    from trepid.processes.page_door import foxglove_port

    settings = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    if scenario is None and has_simulator():
        scenario = settings.scenario
    if scenario is None and changes:
        raise InputError("--set changes a scenario, and this car has no simulator; give --scenario too")
    course = course_for(scenario, parse_overrides(changes or []), chosen or (), duration_s=duration)

    def report_start(text: str) -> None:
        life.cancel()
        say(text)

    door = page.door(settings)
    port = foxglove_port(settings.foxglove_port) if page.foxglove else None
    with show_drive(dashboard) as show:
        return drive_course(
            course,
            settings,
            seed=seed,
            show=show,
            say=report_start,
            record=record,
            raw_images=raw_images,
            page=door,
            foxglove=port,
        )


def of_car() -> str:
    """The folder of the car in use, as text."""
    return f"of {car_folder()}" if car_folder() else ""


def say(text: str) -> None:
    """One line about the start of the drive, unless quiet."""
    note(f"trepid drive: {text}")


@contextmanager
def show_drive(dashboard: bool) -> "Iterator[Show]":
    """Display of the drive on standard error: a live table in a terminal, else a line every few seconds.

    Without the table, each new warning or error of a process is a line of its own; these only, when quiet.
    """
    from rich.console import Console
    from rich.live import Live

    console = Console(stderr=True)
    if dashboard and console.is_terminal and loudness() is not Loudness.QUIET:
        with Live(console=console, auto_refresh=False, transient=True) as live:
            yield lambda log, fleet, elapsed_s: live.update(
                status(log, fleet, elapsed_s=elapsed_s), refresh=True
            )
        return
    printed_s = -PLAIN_PERIOD_S
    reported: dict[str, tuple[Health, str]] = {}  # newest state of each process

    def show(log: "DriveLog", fleet: "Fleet", elapsed_s: float) -> None:
        nonlocal printed_s
        for beat in log.diagnostics.values():
            state = beat.health, " ".join(beat.message.split())
            if beat.health is not Health.OK and state != reported.get(beat.process):
                warn(f"process {beat.process}: {state[0]}: {state[1]}")
            reported[beat.process] = state
        if loudness() is Loudness.QUIET:
            return
        if elapsed_s - printed_s >= PLAIN_PERIOD_S or elapsed_s < printed_s:
            printed_s = elapsed_s
            warn(driving_line(log, elapsed_s=elapsed_s).plain)

    yield show


def status(log: "DriveLog", fleet: "Fleet", *, elapsed_s: float) -> "Group":
    """Table of the processes with rates and ages, and below it a line about the car and its fear."""
    from rich.console import Group
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("process", "pid", "steps/s", "last beat", "cpu %", "restarts", "message"):
        table.add_column(heading, justify="left" if heading in ("process", "message") else "right")
    for name, child in fleet.children.items():
        beat = log.diagnostics.get(name)
        values = dict(beat.values) if beat else {}
        table.add_row(
            name,
            str(child.popen.pid),
            escape(values.get("rate_hz", "-")),
            f"{log.now_s() - beat.t_s:z.1f} s" if beat else "-",
            escape(values.get("cpu_percent", "-")),
            str(child.restarts),
            escape(beat.message) if beat else "starting" if child.alive else "ended",
        )
    return Group(table, driving_line(log, elapsed_s=elapsed_s))


def driving_line(log: "DriveLog", *, elapsed_s: float) -> "Text":
    """One line: time, place, speed, lateral error, mode, fear with its cause, and what the car does and why."""
    from rich.text import Text

    text = Text(f"t {elapsed_s:z6.1f} s")
    if log.waiting:
        return text.append(f"  {log.waiting}")
    truth, state, decision = log.truth, log.state, log.decision
    if truth is not None:
        text.append(f"  at {truth.station_m:z6.1f} m ({truth.section})")
        text.append(f"  error {truth.lateral_offset_m:+z.2f} m")
    if state is not None and state.speed_mps is not None:
        text.append(f"  speed {state.speed_mps:z4.1f} m/s")
    if decision is not None:
        colour = FEAR_COLOURS.get(decision.level, "white")
        text.append(f"  {Mode.STOP if log.own_stop else decision.mode}", style="bold")
        cause = in_words(decision.cause, decision.part)
        said = "" if decision.cause == Cause.NONE or cause in log.reason else f": {cause}"
        text.append(f"  fear {decision.fear:z.2f} {decision.level}{said}", style=colour)
    return text.append(f"  {log.reason}", style="bold")


def summary(row: dict[str, Any]) -> "Table":
    """The result as a table."""
    from rich.markup import escape
    from rich.table import Table

    verdict = f"[{'green' if row['status'] == PASSED else 'red'}]{row['status']}[/]"
    title = f"{escape(row['scenario'] or 'drive')} (seed {row['seed']}): {verdict}"
    table = Table(title=title, title_justify="left", box=None)
    table.add_column("what", style="dim")
    table.add_column("value")
    for reason in row["reasons"]:
        table.add_row("reason", f"[red]{escape(reason)}[/]")
    for remark in row["notes"]:
        table.add_row("note", f"[yellow]{escape(remark)}[/]")
    for key, value in row.items():
        if value == "" or key in (
            "scenario",
            "seed",
            "status",
            "reasons",
            "notes",
            "processes",
            "latency_ms",
            "stages_ms",
        ):
            continue
        table.add_row(key, _text(value))
    for name, load_ in row.get("processes", {}).items():
        table.add_row(f"process {name}", ", ".join(f"{key} {value}" for key, value in load_.items()))
    for name, times in row.get("latency_ms", {}).items():
        table.add_row(f"{name} ms", _text(times))
    return table


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:z.3f}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return "-" if value is None else str(value)
