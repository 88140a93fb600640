"""The benchmark of the loop counts the driven time by both clocks and lists the peers."""

import pytest

from lab.bench import lockstep as bench
from sim_harness.scenarios.scenario import load_scenario


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Half a second of the circuit, without rendering: the test is of the bookkeeping."""
    lap = load_scenario("circuit", {"sight": "truth"}).shorten(0.5)
    monkeypatch.setattr(bench, "load_scenario", lambda name, changes: lap)


def test_a_step_is_a_vehicle_period(monkeypatch):
    monkeypatch.setattr(bench, "realtime_factors", lambda scenario, *, seed: (40.0 + seed, 80.0 + seed))
    monkeypatch.setattr(bench, "peers", lambda vehicle: {})
    rows = bench.bench_lockstep()
    assert set(rows) == set(bench.SIGHTS)
    for row in rows.values():
        assert row["realtime_factor"] == 41.0
        assert row["realtime_factor_by_computing_time"] == 81.0
        assert row["steps_per_s"] == 8100
        assert len(row["runs"]) == bench.RUNS


def test_peers_are_measured_in_the_same_run(monkeypatch):
    monkeypatch.setattr(bench, "peers", lambda vehicle: {"rival": lambda step: None})
    monkeypatch.setattr(bench, "steps_per_s", lambda advance: 123.4)
    assert bench.bench_lockstep()["rival"] == {"steps_per_s": 123}


def test_factors_are_of_the_time_that_was_driven(monkeypatch):
    clock = iter([10.0, 10.25])
    computing = iter([1.0, 1.125])
    monkeypatch.setattr(bench.time, "perf_counter", lambda: next(clock))
    monkeypatch.setattr(bench.time, "process_time", lambda: next(computing))
    wall, used = bench.realtime_factors(bench.load_scenario("circuit", {}), seed=0)
    assert (wall, used) == (pytest.approx(2.0), pytest.approx(4.0))
