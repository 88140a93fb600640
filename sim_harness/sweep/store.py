"""Results in a JSON Lines file: one line a row, appended as the row is finished; a second call continues.

A row belongs to a case and to the code that computed it (:mod:`sim_harness.sweep.fingerprint`). Rows of other code
stay in the file and are ignored. A line that was half written when its writer was killed is cut off.
"""

import fcntl
import json
import os
from collections.abc import Callable, Generator, Mapping, Set
from contextlib import closing
from pathlib import Path
from typing import Any, Self, TypeVar

from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.pool import Lost, WorkerLost, imap_unordered
from sim_harness.sweep.progress import SweepProgress
from trepid.config import InputError

Row = dict[str, Any]
Key = TypeVar("Key")
Task = TypeVar("Task")
Result = TypeVar("Result")

CASE, CODE = "case", "code"  # fields of a stored line besides those of the row


class Store:
    """Rows by case and code. Use as a context manager: one process at a time may have the file open."""

    def __init__(self, path: Path, *, fields: Set[str] = frozenset()) -> None:
        """``fields`` are required of every row.

        Raises InputError when ``path`` cannot be written, is in use, or holds a line that is not a row.
        """
        self.path = path
        self._fields = {CASE, CODE} | fields
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._file)
            raise InputError(f"{path}: another sweep is writing to it") from error
        try:
            self.newest = self._read()
            """The newest line of each case, whatever code computed it, CASE and CODE included."""
        except BaseException:
            os.close(self._file)
            raise

    def get(self, case: str, code: str) -> Row | None:
        """The row of a case that ``code`` computed; None when there is none."""
        return self._rows.get((case, code))

    def add(self, case: str, code: str, row: Row) -> None:
        """Append a row; after the return only a failure of the machine can lose it."""
        line = {CASE: case, CODE: code, **row}
        os.write(self._file, (json.dumps(line) + "\n").encode())
        self._rows[case, code], self.newest[case] = row, line

    def close(self) -> None:
        """Release the file for other processes."""
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self) -> dict[str, Row]:
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            os.truncate(self._file, whole)
        self._rows: dict[tuple[str, str], Row] = {}
        newest = {}
        for number, line in enumerate(data[:whole].splitlines(), start=1):
            try:
                row: Any = json.loads(line)
            except ValueError:
                row = None
            if not isinstance(row, dict) or not row.keys() >= self._fields:
                raise InputError(f"{self.path}:{number}: not a result of a sweep")
            newest[row[CASE]] = row
            self._rows[row[CASE], row[CODE]] = content(row)
        return newest


def content(line: Row) -> Row:
    """The row in a stored line: all but its case and code."""
    return {name: value for name, value in line.items() if name not in (CASE, CODE)}


def finish_tasks(
    work: Callable[[Task], Result], tasks: Mapping[Key, Task], jobs: int
) -> Generator[tuple[Key, Result], None, None]:
    """``work(task)`` of every task as they finish, in this process or on ``jobs`` processes, with progress.

    Raises WorkerLost at the end, after the other tasks, when worker processes were killed.
    """
    lost: list[str] = []
    with SweepProgress(len(tasks), float(len(tasks))) as progress:
        if jobs == 1:
            for key, task in tasks.items():
                yield key, work(task)
                progress.step(1.0)
            return
        with closing(imap_unordered(work, tasks, jobs)) as results:
            for key, result in results:
                if isinstance(result, Lost):
                    lost.append(f"{key}: its process {result.reason}")
                else:
                    yield key, result
                progress.step(1.0)
    if lost:
        raise WorkerLost(f"{len(lost)} cases have no result, first {lost[0]}; the same command continues")


def stored_rows(
    path: Path,
    work: Callable[[Task], Row],
    tasks: Mapping[str, Task],
    *,
    codes: Mapping[str, str] | None = None,
    jobs: int | None = None,
) -> list[Row]:
    """``work(task)`` of every task, in their order; rows of the same code in ``path`` are not computed again.

    ``codes`` are hashes of the code of each task; default: that of all code. ``jobs`` is the number of processes;
    default: that of the cores. Raises InputError when the file is in use or holds something else, and WorkerLost.
    """
    codes = codes or dict.fromkeys(tasks, fingerprint())
    with Store(path) as store:
        left = {key: task for key, task in tasks.items() if store.get(key, codes[key]) is None}
        with closing(finish_tasks(work, left, jobs or os.cpu_count() or 1)) as rows:
            for key, row in rows:
                store.add(key, codes[key], row)
        return [store.get(key, codes[key]) or {} for key in tasks]
