"""The pool of worker processes outlives neither an interrupt nor who started it."""

import os
import signal
import subprocess
import sys

import pytest
from process_rig import alive, until

from sim_harness.sweep.crew import crew

PATIENCE_S = 60.0
SCRIPT = """
import os, sys, time
from sim_harness.sweep.crew import crew

def work(path):
    with open(path + ".new", "w") as file:
        file.write(str(os.getpid()))
    os.replace(path + ".new", path)
    time.sleep(600)

if __name__ == "__main__":
    with crew(1) as workers:
        workers.submit(work, sys.argv[1]).result()
"""


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_who_started_them(tmp_path, ending):
    script, told = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(SCRIPT)
    starter = subprocess.Popen(
        [sys.executable, str(script), str(told)], stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        assert until(told.exists, patience_s=PATIENCE_S)
        worker = int(told.read_text())
        os.kill(starter.pid, ending)
        starter.wait(timeout=PATIENCE_S)
        assert until(lambda: not alive(worker), patience_s=PATIENCE_S)
    finally:
        if starter.poll() is None:
            os.killpg(starter.pid, signal.SIGKILL)


def test_workers_calculate_on_one_thread_and_who_started_them_as_before(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with crew(1) as workers:
        assert workers.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    assert "OMP_NUM_THREADS" not in os.environ
