"""The rule file of a drive on the page: its sets, its text, a check, and its replacement while the car drives."""

import hashlib
import os
import re
import tempfile
from pathlib import Path
from typing import Any

from cockpit.page.checker import Checker
from trepid.config import InputError, car_folder, read_text
from trepid.files.whole import write_whole

PLACED = re.compile(r"^(?P<file>.*?):(?P<line>\d+):(?P<column>\d+): (?P<text>.*)$")


class Conflict(Exception):
    """The file has changed since the edit began."""


class RuleDesk:
    """Reads and checks the rule file of a drive, and replaces it by an edited one."""

    def __init__(self, path: Path, edited: Path) -> None:
        """``path``: the file in use; ``edited``: where an edit of it is kept, the same or a file that is new."""
        self.path, self._edited = path, edited
        self._checker = Checker()

    def show(self) -> dict[str, Any]:
        """Path, text, its hash, and why no edit is kept ("" when it is). Raises InputError."""
        self._checker.start()  # so that the first check finds it ready
        text = read_text(self.path)
        return {"path": str(self.path), "text": text, "sha256": _sha256(text), "fixed": self.fixed_reason}

    @property
    def fixed_reason(self) -> str:
        """Why the page does not replace the file; "" when it does."""
        car = car_folder()
        if car is not None and car not in self._edited.parents:
            return f"{self.path} is not in the folder of the car: copy it to {car / 'fear.yaml'}, and drive again"
        if not os.access(self._edited.parent, os.W_OK):
            return f"{self._edited.parent} cannot be written"
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
        """The output of ``trepid fear check`` for ``text``: ``ok``, and its lines with the place of each."""
        with tempfile.TemporaryDirectory() as folder:
            draft = Path(folder) / self.path.name
            draft.write_text(text, encoding="utf-8")
            ok, said = self._checker.check(draft)
        return _verdict(ok, [line.replace(str(draft), str(self.path)) for line in said])

    def close(self) -> None:
        """End the process that checks."""
        self._checker.close()

    def apply(self, text: str, sha256: str) -> dict[str, Any]:
        """Write ``text`` to the place of an edit if it passes the check; ``sha256``: of the text that was edited.

        The file is replaced whole; a reader gets the old text or the new one. Raises Conflict when the file in use
        has changed meanwhile, InputError when the new one cannot be written.
        """
        if self.fixed_reason:
            raise InputError(self.fixed_reason)
        verdict = self.check(text)
        if not verdict["ok"]:
            return verdict
        if _sha256(read_text(self.path)) != sha256:
            raise Conflict(f"{self.path} has changed since the edit began: read it again")
        target = self._edited.resolve()  # a link stays a link
        if self._edited != self.path and target.exists():
            raise Conflict(
                f"{target} has been written by another program meanwhile: move it, and apply again"
            )
        try:
            write_whole(target, text.encode())
        except OSError as error:
            raise InputError(f"{target}: cannot be written: {error.strerror}") from error
        self.path = self._edited
        return {**verdict, "sha256": _sha256(text), "path": str(self.path)}


def _verdict(ok: bool, lines: list[str]) -> dict[str, Any]:
    return {"ok": ok, "lines": [_place_line(line) for line in lines if line.strip()]}


def _place_line(line: str) -> dict[str, Any]:
    found = PLACED.match(line)
    if found is None:
        return {"line": None, "column": None, "text": line}
    return {"line": int(found["line"]), "column": int(found["column"]), "text": line}


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
