"""A pool of fresh processes that an interrupt ends at once, for runs that are not cases of a plan."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from sim_harness.sweep.processes import ONE_THREAD


@contextmanager
def crew(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes for runs; an interrupt ends them at once."""
    os.environ.update(ONE_THREAD | os.environ)
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_deaf)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(pool._processes.values()):  # the pool has no public way to end a running task
            process.kill()
        raise
    finally:
        pool.shutdown()


def _deaf() -> None:
    """Who started a worker ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
