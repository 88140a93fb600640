"""A pool of fresh processes that an interrupt ends at once, for runs that are not cases of a plan."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

from sim_harness.sweep.processes import ONE_THREAD


@contextmanager
def crew(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes for runs; an interrupt ends them at once, and so does the death of who started them."""
    before = dict(os.environ)
    os.environ.update(ONE_THREAD | before)
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_enlisted)
    try:
        yield pool
    except BaseException:
        # The pool has no public way to end a task, and forgets its processes when it shuts down.
        processes = list(pool._processes.values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        raise
    finally:
        pool.shutdown()
        for name in ONE_THREAD.keys() - before:  # of the workers only
            del os.environ[name]


def _enlisted() -> None:
    """Who started a worker ends it; when that one is killed nothing closes the pipes, so it is watched."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
