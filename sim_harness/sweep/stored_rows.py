"""The rows of a long benchmark: computed on all cores and stored one by one, so that a second call continues."""

import os
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.pool import Lost, WorkerLost, imap_unordered
from sim_harness.sweep.progress import SweepProgress
from sim_harness.sweep.store import Row, Store

Task = TypeVar("Task")


def stored_rows(path: Path, work: Callable[[Task], Row], tasks: Mapping[str, Task]) -> list[Row]:
    """``work(task)`` of every task, in their order; rows of the current code in ``path`` are not computed again.

    Raises InputError when the file is in use or holds something else, and WorkerLost at the end, after the other
    tasks, when worker processes were killed.
    """
    code = fingerprint()
    lost: list[str] = []
    with Store(path) as store:
        left = {key: task for key, task in tasks.items() if store.get(key, code) is None}
        with (
            SweepProgress(len(left), float(len(left))) as progress,
            closing(imap_unordered(work, left, os.cpu_count() or 1)) as results,
        ):
            for key, row in results:
                if isinstance(row, Lost):
                    lost.append(f"{key}: its process {row.reason}")
                else:
                    store.add(key, code, row)
                progress.step(1.0)
        if lost:
            raise WorkerLost(f"{path}: {len(lost)} cases have no result, first {lost[0]}")
        return [store.get(key, code) or {} for key in tasks]
