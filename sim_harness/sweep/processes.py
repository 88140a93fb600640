"""Cases on the cores of this machine.

Each worker is a fresh interpreter that stays for the whole sweep and has one case at a time: a worker that is
killed loses that case only, and it is known which.
"""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running

from sim_harness.scenarios.sampling import Case
from sim_harness.sweep.outcome import Outcome, crashed, execute
from sim_harness.sweep.plan import Plan

# One worker a core: libraries that start threads of their own would only get in each other's way. They read these
# when they are loaded; OpenCV and ONNX Runtime are told in the code.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def in_this_process(plan: Plan, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases one after the other, here."""
    for key, case in plan.items():
        yield key, execute(case, detailed=detailed)


def on_processes(plan: Plan, jobs: int, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases on ``jobs`` processes; outcomes come as they finish.

    The case of a worker that dies is a crashed one, and a new worker takes its place. Closing the iterator kills
    the workers at once.
    """
    waiting = iter(plan.items())
    crew: dict[Connection, _Worker] = {}
    try:
        for key, case in islice(waiting, jobs):
            worker = _Worker.hired(key, case, detailed)
            crew[worker.pipe] = worker
        while crew:
            for pipe in wait(list(crew)):
                worker = crew.pop(pipe)  # type: ignore[call-overload]
                key, outcome = worker.key, worker.outcome()
                for following in islice(waiting, 1):
                    worker = worker if worker.give(*following) else _Worker.hired(*following, detailed)
                    crew[worker.pipe] = worker
                if worker.pipe not in crew:
                    worker.kill()
                yield key, outcome
    finally:
        for worker in crew.values():
            worker.kill()


@dataclass(slots=True)
class _Worker:
    """A process, and the case that it has."""

    process: SpawnProcess
    pipe: Connection
    key: str
    case: Case

    @classmethod
    def hired(cls, key: str, case: Case, detailed: bool) -> "_Worker":
        """A new process with its first case. An interrupt from the keyboard never reaches it: we end it."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, detailed), daemon=True)
        os.environ.update(ONE_THREAD | os.environ)
        ensure_running()  # when a process starts it instead, it lets interrupts through
        masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # children inherit it
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        theirs.close()  # the worker has the only other end now: its death closes the pipe
        worker = cls(process, ours, key, case)
        worker.give(key, case)
        return worker

    def give(self, key: str, case: Case) -> bool:
        """Let it run a case; False when it is gone."""
        self.key, self.case = key, case
        try:
            self.pipe.send(case)
        except OSError:
            return False
        return True

    def outcome(self) -> Outcome:
        """What came of its case; the case has crashed when the worker is gone."""
        try:
            outcome: Outcome = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            self.pipe.close()
            return crashed(self.case, f"crashed: its process {_end(self.process.exitcode)}")
        return outcome

    def kill(self) -> None:
        """End it, whatever it is doing."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, detailed: bool) -> None:
    """Run cases until the other end is gone."""
    while True:
        try:
            pipe.send(execute(pipe.recv(), detailed=detailed))
        except (EOFError, BrokenPipeError):
            return


def _end(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended by itself with exit code {code}"
