"""A process that checks rule files for the live page, as ``trepid fear check`` does.

The page has the lowest priority of a drive, and the start of Python takes longer than the check. So the process
starts with the tab of the rules, in a session of its own, which Linux schedules beside that of the page and not
below it, and then waits for drafts: one JSON line in, ``{"file": PATH}``, one out, ``{"ok": BOOLEAN, "said": [LINE,
...]}``. It ends with its standard input.
"""

import contextlib
import io
import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from trepid.config import CONFIG_DIR, ROOT

CHECK_S = 60.0  # longest time for a check


class Checker:
    """The resident process; it starts again after it has ended."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._turn = threading.Lock()

    def start(self) -> None:
        """Start the process, unless it runs."""
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "cockpit.page.checker"],
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                start_new_session=True,
            )

    def check(self, file: Path) -> tuple[bool, list[str]]:
        """Whether the rules of ``file`` are fit to drive, and the lines about them, one check after the other."""
        with self._turn:
            self.start()
            process = self._process
            assert process is not None and process.stdin is not None and process.stdout is not None
            watchdog = threading.Timer(CHECK_S, process.kill)
            watchdog.start()
            try:
                process.stdin.write(f"{json.dumps({'file': str(file)})}\n")
                process.stdin.flush()
                answer = process.stdout.readline()
            except BrokenPipeError:
                answer = ""
            finally:
                watchdog.cancel()
        if not answer:
            return False, [f"{file}: the check ended without a result, or took longer than {CHECK_S:.0f} s"]
        found = json.loads(answer)
        return found["ok"], found["said"]

    def close(self) -> None:
        """End the process, which holds nothing that is to be saved."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()


def check_file(file: Path) -> dict[str, Any]:
    """``ok`` and the lines that ``trepid fear check FILE`` prints, errors first."""
    import typer

    from cockpit.rulebook.cli import app
    from trepid.config import InputError

    out, problems = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(problems):
        try:
            code = typer.main.get_command(app).main(["check", str(file)], standalone_mode=False) or 0
        except InputError as error:
            code, _ = 2, problems.write(f"{error}\n")
    return {"ok": code == 0, "said": (problems.getvalue() + out.getvalue()).splitlines()}


def main() -> None:
    """Check a file for every line of the standard input."""
    check_file(CONFIG_DIR / "fear.yaml")  # loads what a check needs
    for line in sys.stdin:
        print(json.dumps(check_file(Path(json.loads(line)["file"]))), flush=True)


if __name__ == "__main__":
    main()
