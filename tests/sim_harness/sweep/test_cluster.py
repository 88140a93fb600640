"""A sweep on a real Dask scheduler with two real worker processes. Run by ``make proof``."""

import os
import re
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import Scenario
from sim_harness.sweep.fingerprint import hash_of_files
from sim_harness.sweep.plan import by_seeds, plan
from sim_harness.sweep.sweep import in_this_process
from trepid.config import CAR, ROOT, InputError

distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
from sim_harness.sweep import cluster  # noqa: E402

pytestmark = pytest.mark.proof

SECONDS = Scenario(
    name="s", description="some seconds", tags=["nominal"], road="circuit", duration_s=8.0, sight="truth"
)
CASES = 24


class Dask:
    """A scheduler and two workers, each a process."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        hash_of_files.cache_clear()  # the workers read the code as it is now
        scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.scheduler = scheduler
        self.address = awaited_line(scheduler, r"Scheduler at:\s+(tcp://\S+)")
        self.workers = [self.worker(), self.worker()]

    def worker(self) -> subprocess.Popen[str]:
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0")
        worker = self.start("worker", self.address, *options)
        awaited_line(worker, r"(Registered to)")
        return worker

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments], cwd=ROOT, stderr=subprocess.PIPE, text=True
        )
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


def awaited_line(process, pattern):
    """The first match in the output of ``process``."""
    for line in process.stderr:
        found = re.search(pattern, line)
        if found:
            return found[1]
    raise AssertionError(f"it ended without saying {pattern}")


@pytest.fixture
def dask():
    with ExitStack() as stack:
        yield Dask(stack)


def hashes(outcomes):
    return {key: outcome.row["trace_sha256"] for key, outcome in outcomes}


def test_a_worker_that_is_killed_mid_sweep_loses_no_case(dask):
    planned = plan(by_seeds([SECONDS], range(CASES)))
    outcomes = []
    for outcome in cluster.on_cluster(planned, dask.address):
        outcomes.append(outcome)
        if len(outcomes) == 5:
            os.kill(dask.workers[0].pid, signal.SIGKILL)
    assert dask.workers[0].wait() == -signal.SIGKILL
    assert len(outcomes) == CASES
    assert hashes(outcomes) == hashes(in_this_process(planned))


def test_an_exception_fails_only_its_case(dask):
    instant = SECONDS.model_copy(update={"duration_s": 1e-3})  # nothing to score
    cases = [Case(scenario=scenario, index=0, seed=0, parameters={}) for scenario in (instant, SECONDS)]
    outcomes = dict(cluster.on_cluster(plan(cases), dask.address))
    statuses = {o.row["status"]: o.row["reasons"] for o in outcomes.values()}
    assert statuses["passed"] == []
    assert statuses["failed"][0].startswith("crashed: ValueError")


def test_workers_drive_the_car_in_use(dask, monkeypatch, tmp_path):
    planned = plan(by_seeds([SECONDS], range(2)))
    default = hashes(in_this_process(planned))
    (tmp_path / "vehicle.yaml").write_text("understeer_gradient_rad_per_mps2: 0.002\n")
    monkeypatch.setenv(CAR, str(tmp_path))
    ours = hashes(in_this_process(planned))
    assert ours != default
    assert hashes(cluster.on_cluster(planned, dask.address)) == ours
    monkeypatch.delenv(CAR)
    assert hashes(cluster.on_cluster(planned, dask.address)) == default


def test_a_worker_that_joins_later_gets_the_car_too(dask, monkeypatch, tmp_path):
    (tmp_path / "vehicle.yaml").write_text("understeer_gradient_rad_per_mps2: 0.002\n")
    monkeypatch.setenv(CAR, str(tmp_path))
    planned = plan(by_seeds([SECONDS], range(CASES)))
    outcomes = cluster.on_cluster(planned, dask.address)
    first = next(outcomes)
    dask.worker()
    for worker in dask.workers:
        os.kill(worker.pid, signal.SIGKILL)
    assert hashes([first, *outcomes]) == hashes(in_this_process(planned))


def test_wrong_input_ends_the_sweep(dask):
    nowhere = SECONDS.model_copy(update={"road": "no_such_road"})
    with pytest.raises(InputError, match="no_such_road"):
        list(cluster.on_cluster(plan(by_seeds([nowhere], [0])), dask.address))


def test_a_lost_cluster_is_reported(dask):
    planned = plan(by_seeds([SECONDS], range(CASES)))
    outcomes = cluster.on_cluster(planned, dask.address)
    next(outcomes)
    for process in (*dask.workers, dask.scheduler):
        os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(cluster.ClusterLost, match="lost with"):
        list(outcomes)


def test_workers_with_other_code_are_refused(dask, monkeypatch):
    check = cluster._check_code
    monkeypatch.setattr(cluster, "_check_code", lambda found, _, address: check(found, "0" * 16, address))
    with pytest.raises(InputError, match="a worker has other code"):
        next(cluster.on_cluster(plan(by_seeds([SECONDS], [0])), dask.address))


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1:1", ""])
def test_a_scheduler_without_an_answer_is_reported_in_one_line(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        next(cluster.on_cluster(plan(by_seeds([SECONDS], [0])), address))
