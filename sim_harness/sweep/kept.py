"""The rows of a bench that takes long: worked out on all cores, each on file as soon as it is there.

A bench that was stopped goes on from its file. Rows of other code or configuration stay there, but count no more.
"""

import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import as_completed
from pathlib import Path
from typing import TypeVar

from sim_harness.sweep.crew import crew
from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.outcome import Row
from sim_harness.sweep.progress import SweepProgress
from sim_harness.sweep.store import CASE, CODE, read_lines

Task = TypeVar("Task")


def kept_rows(path: Path, work: Callable[[Task], Row], tasks: Mapping[str, Task]) -> list[Row]:
    """``work`` of every task, in their order; what ``path`` holds by the same key and code is not done again.

    Raises InputError where the file holds something else.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    code = fingerprint()
    rows = {key: row for key, row in read_lines(path, {CASE, CODE}).items() if row[CODE] == code}
    left = [key for key in tasks if key not in rows]
    with (
        crew(os.cpu_count() or 1) as workers,
        SweepProgress(len(left), float(len(left))) as progress,
        path.open("a", encoding="utf-8") as file,
    ):
        keys = {workers.submit(work, tasks[key]): key for key in left}
        for done in as_completed(keys):
            key = keys[done]
            rows[key] = {CASE: key, CODE: code, **done.result()}
            file.write(json.dumps(rows[key]) + "\n")
            file.flush()
            progress.step(1.0)
    return [rows[key] for key in tasks]
