"""A pool of worker processes on this machine.

Each worker is a fresh interpreter that handles one task at a time. A worker that is killed loses only that task. An
interrupt ends all workers at once, and workers end themselves when the process that started them ends. They import
the script that runs only for what it defines itself: it needs no guard against being executed in each of them.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from typing import Any, Generic, TypeVar

from trepid.config import InputError

# One worker uses one core. The numerical libraries read these when they are loaded; OpenCV and ONNX Runtime are
# limited in the code.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_CONTEXT = multiprocessing.get_context("spawn")

Key = TypeVar("Key")
Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Lost:
    """In place of a result: the worker process of the task ended before it returned one."""

    reason: str  # "was killed by SIGKILL", "ended with exit code 1"


class WorkerLost(InputError):
    """A task has no result because its worker process was killed; reported to the user in one line."""


def imap_unordered(
    work: Callable[[Task], Result], tasks: Mapping[Key, Task], jobs: int
) -> Generator[tuple[Key, Result | Lost], None, None]:
    """``work(task)`` of every task on ``jobs`` processes, by key, as they finish.

    ``work``, tasks and results must be picklable. Raises what ``work`` raises, after the results that are ready by
    then. Closing the generator kills the workers.
    """
    waiting = iter(tasks.items())
    workers: dict[Any, _Worker[Key, Task, Result]] = {}
    try:
        for key, task in islice(waiting, jobs):
            worker = _Worker.start(work, key, task)
            workers[worker.pipe] = worker
        raised: Exception | None = None
        while workers and raised is None:
            for pipe in wait(list(workers)):
                worker = workers[pipe]
                key, result = worker.key, worker.result()
                if isinstance(result, _TaskError):
                    raised = result.error
                    continue
                del workers[pipe]
                for following in islice(waiting, 1):
                    worker = worker if worker.give(*following) else _Worker.start(work, *following)
                    workers[worker.pipe] = worker
                if worker.pipe not in workers:
                    worker.kill()
                yield key, result
        if raised is not None:
            raise raised
    finally:
        for worker in workers.values():
            worker.kill()


def imap(work: Callable[[Task], Result], tasks: Iterable[Task], jobs: int) -> Generator[Result, None, None]:
    """``work(task)`` of every task on ``jobs`` processes, in the order of the tasks.

    Raises what ``work`` raises, and WorkerLost. Closing the generator kills the workers.
    """
    finished: dict[int, Result] = {}
    due = 0
    with closing(imap_unordered(work, dict(enumerate(tasks)), jobs)) as results:
        for number, result in results:
            if isinstance(result, Lost):
                raise WorkerLost(f"a worker process {result.reason}")
            finished[number] = result
            while due in finished:
                yield finished.pop(due)
                due += 1


def start(target: Callable[..., object], *arguments: object, script: bool = True) -> SpawnProcess:
    """Start ``target(*arguments)`` in a fresh interpreter whose libraries use one thread.

    With ``script`` it imports the script that runs, if one does, as usual with multiprocessing. Keyboard interrupts
    do not reach the process: its starter ends it. It ends itself when its starter has ended.
    """
    process = _CONTEXT.Process(target=_run, args=(target, *arguments), daemon=True)
    ensure_running()  # a tracker that a worker starts would not have the mask below
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited by the process
    added = {name: value for name, value in ONE_THREAD.items() if name not in os.environ}
    os.environ.update(added)
    try:
        with nullcontext() if script else _hide_script():
            process.start()
    finally:
        for name in added:
            del os.environ[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return process


@contextmanager
def _hide_script() -> Iterator[None]:
    """A new process finds the script by its file name, and imports none without."""
    program = vars(sys.modules["__main__"])
    name = program.pop("__file__", None)
    try:
        yield
    finally:
        if name is not None:
            program["__file__"] = name


def _run(target: Callable[..., object], *arguments: object) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    target(*arguments)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@dataclass(frozen=True, slots=True)
class _TaskError:
    """An exception that a task raised."""

    error: Exception


@dataclass(slots=True)
class _Worker(Generic[Key, Task, Result]):
    """A process and its current task."""

    process: SpawnProcess
    pipe: Connection
    key: Key

    @classmethod
    def start(cls, work: Callable[[Task], Result], key: Key, task: Task) -> "_Worker[Key, Task, Result]":
        """A new process with its first task."""
        ours, theirs = _CONTEXT.Pipe()
        process = start(_serve, theirs, work, script=b"__main__" in pickle.dumps((work, task)))
        theirs.close()  # the worker then holds the only other end, and its end closes the pipe
        worker = cls(process, ours, key)
        worker.give(key, task)
        return worker

    def give(self, key: Key, task: Task) -> bool:
        """Send the next task; False when the process has ended."""
        self.key = key
        try:
            self.pipe.send(task)
        except OSError:
            return False
        return True

    def result(self) -> "Result | Lost | _TaskError":
        """Result of the current task."""
        try:
            result: Result | _TaskError = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            self.pipe.close()
            code = self.process.exitcode or 0
            killed = f"was killed by {signal.Signals(-code).name}" if code < 0 else ""
            return Lost(killed or f"ended with exit code {code}")
        return result

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, work: Callable[[Any], object]) -> None:
    """Handle tasks until the other end of the pipe is closed."""
    while True:
        try:
            pipe.send(_attempt(work, pipe.recv()))
        except (EOFError, BrokenPipeError):
            return


def _attempt(work: Callable[[Any], object], task: object) -> object:
    try:
        return work(task)
    except Exception as error:  # noqa: BLE001
        text = traceback.format_exc()
        error.add_note(f"in a worker process:\n{text}")
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # noqa: BLE001 - an exception with required arguments cannot be rebuilt from its text
            return _TaskError(RuntimeError(text))
        return _TaskError(error)
