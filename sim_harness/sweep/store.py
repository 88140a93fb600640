"""The results of a sweep in a file, a line each as they finish; a sweep that was interrupted goes on from there.

JSON Lines always: whole lines are safe whatever happens to the process that writes them. Parquet, whose files are
only complete when they are closed, is made from them at the end.
"""

import fcntl
import json
import os
from collections.abc import Mapping, Set
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sim_harness.sweep.outcome import Row, is_complete
from sim_harness.sweep.plan import Plan
from trepid.config import InputError

CASE, CODE = (
    "case",
    "code",
)  # what a stored line has besides the row: the key, and the fingerprint of who ran it
SWEPT = frozenset({CASE, CODE, "trace_sha256"})
RUNS = "runs"  # name of the files in a folder


class Store:
    """The rows of a plan, complete ones by key in ``done``; use it as a context.

    ``out`` is a folder, a .jsonl file or a .parquet file, beside which the .jsonl stands.
    """

    def __init__(self, out: Path, plan: Plan, *, code: str, resume: bool) -> None:
        """Raises InputError when ``out`` cannot be written, or holds results and ``resume`` does not fit them."""
        self.lines, self.parquet = _files(out)
        self._code = code
        if self.lines.exists() and self.lines.stat().st_size and not resume:
            raise InputError(f"{self.lines}: holds results; --resume goes on with them")
        try:
            self.lines.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.lines, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise InputError(f"{self.lines}: cannot be written: {error.strerror}") from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._file)
            raise InputError(f"{self.lines}: another sweep is writing to it") from error
        stored = read_lines(self.lines)
        strangers = stored.keys() - plan.keys()
        if strangers:
            raise InputError(
                f"{self.lines}: of another plan: {len(strangers)} of its cases are not in this one"
            )
        current = {key: row for key, row in stored.items() if row[CODE] == code}
        self.done = {key: _row(row) for key, row in current.items() if is_complete(row)}
        self.crashed, self.outdated = len(current) - len(self.done), len(stored) - len(current)

    def add(self, key: str, row: Row) -> None:
        """Keep a row: once this returns, only the machine can lose it."""
        line = json.dumps({CASE: key, CODE: self._code, **row}) + "\n"
        os.write(self._file, line.encode())

    def close(self) -> None:
        """Write Parquet, if asked for, and let others write."""
        try:
            if self.parquet is not None:
                from sim_harness.sweep.parquet import write

                write(list(read_lines(self.lines).values()), self.parquet)
        finally:
            os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_lines(path: Path, needed: Set[str] = SWEPT) -> dict[str, Row]:
    """The stored rows by case, the last of each, without a line that was half written when its writer died.

    Cuts that half line off. Raises InputError where a whole line is no row with all that is ``needed``.
    """
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if whole < len(data):
        os.truncate(path, whole)
    rows = {}
    for number, line in enumerate(data[:whole].splitlines(), start=1):
        row = _parsed(line)
        if row is None or not row.keys() >= needed:
            raise InputError(f"{path}:{number}: not a result of a sweep")
        rows[row[CASE]] = row
    return rows


def _parsed(line: bytes) -> Row | None:
    try:
        row: Any = json.loads(line)
    except ValueError:
        return None
    return row if isinstance(row, dict) else None


def _row(stored: Mapping[str, Any]) -> Row:
    return {name: value for name, value in stored.items() if name not in (CASE, CODE)}


def _files(out: Path) -> tuple[Path, Path | None]:
    """The .jsonl file of ``out``, and the .parquet file if there is to be one. Raises InputError."""
    has_arrow = find_spec("pyarrow") is not None
    if out.suffix == ".jsonl":
        return out, None
    if out.suffix == ".parquet":
        if not has_arrow:
            raise InputError(f"{out}: Parquet needs pyarrow: pip install 'trepid[report]'")
        return out.with_suffix(".jsonl"), out
    if out.suffix and not out.is_dir():
        raise InputError(f"{out}: expected a folder, a .jsonl file or a .parquet file")
    return out / f"{RUNS}.jsonl", out / f"{RUNS}.parquet" if has_arrow else None
