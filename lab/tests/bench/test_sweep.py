"""Sweeps give one hash under load, independent of the process."""

import pytest

from lab.bench.sweep import RUNS_ELSEWHERE, RUNS_HERE, bench_determinism, bench_sweep


@pytest.mark.proof
def test_a_hundred_runs_in_and_across_processes_on_a_loaded_machine_have_one_hash():
    found = bench_determinism(RUNS_HERE, RUNS_ELSEWHERE)
    assert RUNS_HERE + RUNS_ELSEWHERE == 100
    assert found["distinct_hashes"] == 1
    assert len(found["trace_sha256"]) == 64


@pytest.mark.proof
def test_two_jobs_give_the_rows_of_one():
    assert bench_sweep(cases=4, case_s=2.0, sums=100)["same_rows"]
