"""The rule file of a drive on the page: its sets, its text, a check, and its replacement while the car drives."""

import hashlib
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from trepid.config import ROOT, InputError, car_folder, read_text

CHECK_S = 60.0  # longest time for a check
PLACED = re.compile(r"^(?P<file>.*?):(?P<line>\d+):(?P<column>\d+): (?P<text>.*)$")


class Conflict(Exception):
    """The file has changed since the edit began."""


class RuleDesk:
    """Reads, checks and replaces the rule file at ``path``."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def show(self) -> dict[str, Any]:
        """Path, text, its hash, and why it cannot be replaced ("" when it can). Raises InputError."""
        text = read_text(self.path)
        return {"path": str(self.path), "text": text, "sha256": _sha256(text), "fixed": self.fixed}

    @property
    def fixed(self) -> str:
        """Why the page does not replace the file; "" when it does."""
        car = car_folder()
        if car is not None and car not in self.path.parents:
            return f"{self.path} is not in the folder of the car: copy it to {car / 'fear.yaml'}, and drive again"
        if not os.access(self.path.parent, os.W_OK):
            return f"{self.path.parent} cannot be written"
        return ""

    def sets(self) -> list[dict[str, Any]]:
        """The sets of every input, as corners (value, degree), and the range that shows them. Raises InputError."""
        from cockpit.rulebook.figure import shown_range
        from supervisor.rules.inference import FearRules

        rules = FearRules.load(self.path)
        return [
            {
                "name": name,
                "meaning": spec.meaning,
                "unit": spec.unit,
                "rising": spec.risk == "rising",
                "range": list(shown_range(spec)),
                "sets": {level: [list(c) for c in shape.corners()] for level, shape in spec.shapes.items()},
            }
            for name, spec in rules.inputs.items()
        ]

    def check(self, text: str) -> dict[str, Any]:
        """The output of ``trepid fear check`` for ``text``: ``ok``, and its lines with the place of each.

        It runs as a process of its own: to read and prove a rule file takes as long as many pictures.
        """
        with tempfile.TemporaryDirectory() as folder:
            draft = Path(folder) / self.path.name
            draft.write_text(text, encoding="utf-8")
            command = [sys.executable, "-m", "trepid", "fear", "check", str(draft)]
            try:
                done = subprocess.run(
                    command, cwd=ROOT, capture_output=True, text=True, timeout=CHECK_S, check=False
                )
            except subprocess.TimeoutExpired:
                return _verdict(False, [f"{self.path}: the check takes longer than {CHECK_S:.0f} s"])
            said = (done.stderr + done.stdout).replace(str(draft), str(self.path)).splitlines()
        return _verdict(done.returncode == 0, said)

    def apply(self, text: str, sha256: str) -> dict[str, Any]:
        """Replace the file by ``text`` if it passes the check; ``sha256``: of the text that was edited.

        The file is replaced whole; a reader gets the old text or the new one. Raises Conflict when it has changed
        meanwhile, InputError when it cannot be written.
        """
        if self.fixed:
            raise InputError(self.fixed)
        verdict = self.check(text)
        if not verdict["ok"]:
            return verdict
        if _sha256(read_text(self.path)) != sha256:
            raise Conflict(f"{self.path} has changed since the edit began: read it again")
        target = self.path.resolve()  # a link stays a link
        try:
            with tempfile.NamedTemporaryFile(
                "w", dir=target.parent, prefix=f".{target.name}.", delete=False, encoding="utf-8"
            ) as file:
                fresh = Path(file.name)
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            fresh.chmod(target.stat().st_mode)
            fresh.replace(target)
        except OSError as error:
            raise InputError(f"{target}: cannot be written: {error.strerror}") from error
        return {**verdict, "sha256": _sha256(text)}


def _verdict(ok: bool, lines: list[str]) -> dict[str, Any]:
    return {"ok": ok, "lines": [_placed(line) for line in lines if line.strip()]}


def _placed(line: str) -> dict[str, Any]:
    found = PLACED.match(line)
    if found is None:
        return {"line": None, "column": None, "text": line}
    return {"line": int(found["line"]), "column": int(found["column"]), "text": line}


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
