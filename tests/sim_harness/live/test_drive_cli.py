"""The display of a live drive without a terminal."""

from types import SimpleNamespace

from sim_harness.live.drive_cli import shown
from trepid.messages import Diagnostic, Health

KEPT = "old rules kept: fear.yaml:3:5: no such input"
REPORTED = f"process supervisor: warn: {KEPT}"


def test_without_a_terminal_each_new_warning_of_a_process_is_one_line(capsys):
    log = SimpleNamespace(waiting="", truth=None, state=None, decision=None, diagnostics={})
    beats = [
        (Health.OK, "ready"),
        (Health.WARN, KEPT),
        (Health.WARN, KEPT),
        (Health.OK, ""),
        (Health.WARN, KEPT),
    ]
    lines = []
    with shown(dashboard=False) as show:
        for number, (health, message) in enumerate(beats):
            beat = Diagnostic(t_s=0.0, process="supervisor", health=health, message=message, values=())
            log.diagnostics["supervisor"] = beat
            show(log, None, 0.25 * number)
            printed = capsys.readouterr().err.splitlines()
            lines.append([line for line in printed if line.startswith("process")])
    assert lines == [[], [REPORTED], [], [], [REPORTED]]
