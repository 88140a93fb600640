"""The pool of worker processes outlives neither an interrupt nor who started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE_S = 60.0
SCRIPT = """
import os, signal, sys, time
from sim_harness.sweep.crew import crew

def work(path):
    with open(path + ".new", "w") as file:
        file.write(str(os.getpid()))
    os.replace(path + ".new", path)
    time.sleep(600)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs the tests may not listen to it
    with crew(1) as workers:
        workers.submit(work, sys.argv[1]).result()
"""


def wait_until(true, what):
    deadline_s = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.05)


def is_gone(pid):
    """Whether a process has ended; one that nobody has waited for is a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_who_started_them(tmp_path, ending):
    script, told = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(SCRIPT)
    starter = subprocess.Popen(
        [sys.executable, str(script), str(told)], stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        wait_until(told.exists, "no worker began")
        worker = int(told.read_text())
        os.kill(starter.pid, ending)
        starter.wait(timeout=PATIENCE_S)
        wait_until(lambda: is_gone(worker), f"the worker outlived {ending.name}")
    finally:
        if starter.poll() is None:
            os.killpg(starter.pid, signal.SIGKILL)
