"""The pool: every result arrives, a killed worker loses one task, and no worker outlives the pool."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import closing

import pytest
from process_rig import alive, until

from sim_harness.sweep.pool import Lost, WorkerLost, imap, imap_unordered
from trepid.config import ROOT

PATIENCE_S = 60.0
SCRIPT = """
import os, sys, time
from sim_harness.sweep.pool import imap

def work(path):
    with open(path + ".new", "w") as file:
        file.write(str(os.getpid()))
    os.replace(path + ".new", path)
    time.sleep(600)

if __name__ == "__main__":
    list(imap(work, sys.argv[1:], 1))
"""


def reversed_sleep(number):
    time.sleep(0.02 * (8 - number))
    return number


def end_the_process(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def invert(number):
    return 1 / number


def wait_then_invert(task):
    number, awaited = task
    until(lambda: awaited is None or awaited.exists(), patience_s=PATIENCE_S)
    return 1 / number


class Stubborn(Exception):
    def __init__(self, one, two):
        super().__init__(one)


def raise_stubborn(_):
    raise Stubborn(1, 2)


def test_results_arrive_in_the_order_of_the_tasks_or_by_key_as_they_finish():
    assert list(imap(reversed_sleep, range(8), 3)) == list(range(8))
    tasks = {f"{n}": n for n in range(4)}
    assert dict(imap_unordered(reversed_sleep, tasks, 2)) == tasks


def test_a_killed_worker_loses_its_task_and_no_other():
    results = dict(imap_unordered(end_the_process, {n: n for n in range(4)}, 1))
    assert results == {0: 0, 1: Lost("was killed by SIGKILL"), 2: 2, 3: 3}
    with pytest.raises(WorkerLost, match="was killed by SIGKILL"):
        list(imap(end_the_process, range(4), 1))
    assert multiprocessing.active_children() == []


def test_the_exception_of_a_task_is_raised_with_the_line_in_the_worker():
    with pytest.raises(ZeroDivisionError) as caught:
        list(imap(invert, (1, 0), 1))
    assert "return 1 / number" in caught.value.__notes__[0]
    assert multiprocessing.active_children() == []


def test_an_exception_is_raised_after_the_results_that_are_ready_with_it(tmp_path):
    go = tmp_path / "go"
    tasks = {"first": (1, None), "wrong": (0, go), "good": (2, go), "waiting": (1, None)}
    results = imap_unordered(wait_then_invert, tasks, 3)
    assert next(results) == ("first", 1.0)
    go.touch()
    time.sleep(1.0)  # both others finish, and the result of `waiting` as well
    left = {}
    with pytest.raises(ZeroDivisionError):
        left.update(results)
    assert left.get("good") == 0.5
    assert multiprocessing.active_children() == []


def test_an_exception_that_cannot_be_pickled_is_raised_as_text():
    with pytest.raises(RuntimeError, match="Stubborn"):
        list(imap(raise_stubborn, (0,), 1))


def test_a_script_without_a_guard_is_executed_once(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from sim_harness.sweep.pool import imap\nprint(list(imap(abs, (-1, 2), 2)), __file__)\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == (f"[1, 2] {script}\n", "")


def test_closing_kills_the_workers():
    with closing(imap(time.sleep, (0.0, 600.0, 600.0), 2)) as results:
        next(results)
        assert len(multiprocessing.active_children()) == 2
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_process_that_started_them(tmp_path, ending):
    script, reported = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(SCRIPT)
    starter = subprocess.Popen(
        [sys.executable, str(script), str(reported)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        assert until(reported.exists, patience_s=PATIENCE_S)
        worker = int(reported.read_text())
        os.kill(starter.pid, ending)
        starter.wait(timeout=PATIENCE_S)
        assert until(lambda: not alive(worker), patience_s=PATIENCE_S)
    finally:
        if starter.poll() is None:
            os.killpg(starter.pid, signal.SIGKILL)


def test_workers_use_one_thread_and_the_environment_of_the_starter_is_unchanged(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert list(imap(os.getenv, ("OMP_NUM_THREADS",), 1)) == ["1"]
    assert "OMP_NUM_THREADS" not in os.environ
