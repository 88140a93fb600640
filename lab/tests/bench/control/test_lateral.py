"""The bench of cars that differ in all at once."""

from lab.bench.control import lateral
from lab.bench.control.lateral import bench_random


def test_the_summary_counts_the_cases_beyond_the_target(monkeypatch):
    monkeypatch.setattr(lateral, "RANDOM_TARGET_M", 0.0)
    found = bench_random(1, cases=2)
    assert found["cases"] == found["beyond the target"] == 2
    assert 0.0 < found["median [m]"] <= found["99th percentile [m]"] <= found["largest [m]"] < 0.2
    assert bench_random(1, cases=2) == found
