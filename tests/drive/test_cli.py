"""The display of a live drive without a terminal."""

from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

from rich.console import Console

from drive.cli import say, show_drive, status, summary
from trepid.messages import Diagnostic, Health

KEPT = "old rules kept: fear.yaml:3:5: no such input"
REPORTED = f"process supervisor: warn: {KEPT}"


def test_without_a_terminal_each_new_warning_of_a_process_is_one_line(capsys):
    log = SimpleNamespace(waiting="", truth=None, state=None, decision=None, reason="", diagnostics={})
    beats = [
        (Health.OK, "ready"),
        (Health.WARN, KEPT),
        (Health.WARN, KEPT),
        (Health.OK, ""),
        (Health.WARN, KEPT),
    ]
    lines = []
    with show_drive(dashboard=False) as show:
        for number, (health, message) in enumerate(beats):
            beat = Diagnostic(t_s=0.0, process="supervisor", health=health, message=message, values=())
            log.diagnostics["supervisor"] = beat
            show(log, None, 0.25 * number)
            printed = capsys.readouterr().err.splitlines()
            lines.append([line for line in printed if line.startswith("process")])
    assert lines == [[], [REPORTED], [], [], [REPORTED]]


def test_a_full_disk_behind_standard_error_does_not_end_the_drive(monkeypatch):
    full = Path("/dev/full").open("w", buffering=1)  # noqa: SIM115 - cannot be closed without an error
    monkeypatch.setattr("sys.stderr", full)
    say("a line")
    monkeypatch.undo()
    with suppress(OSError):  # the line is still in its buffer
        full.close()


def test_the_words_of_a_process_are_text_and_no_markup(capsys):
    """Rich takes [/dev/video0] for the end of a style that never began, which is an error."""
    words = "[/dev/video0] is absent"
    beat = Diagnostic(
        t_s=0.0, process="camera", health=Health.WARN, message=words, values=(("rate_hz", "[/]"),)
    )
    log = SimpleNamespace(
        waiting="",
        truth=None,
        state=None,
        decision=None,
        reason="the car says why it stands",
        diagnostics={"camera": beat},
        now_s=lambda: 1.0,
    )
    child = SimpleNamespace(popen=SimpleNamespace(pid=7), restarts=0, alive=True)
    row = {"scenario": None, "seed": 0, "status": "failed", "reasons": [words], "notes": [words]}
    console = Console(width=120)
    console.print(status(log, SimpleNamespace(children={"camera": child}), elapsed_s=1.0))
    console.print(summary(row))
    printed = capsys.readouterr().out
    assert printed.count(words) == 3 and printed.count(log.reason) == 1
