"""The benchmarks state what they were measured on and refuse names that they do not know."""

import pytest

from sim_harness.bench.cli import BENCHMARKS, bench, machine, summary_ms, timed
from trepid.config import InputError


def test_the_machine_is_stated_with_load_and_versions() -> None:
    stated = machine()
    assert "cores" in stated["machine"]
    assert len(stated["load_average"]) == 3
    assert all(stated["versions"].values())


def test_the_summary_is_the_median_and_the_99th_percentile_in_milliseconds() -> None:
    assert summary_ms([0.001] * 50 + [0.002] * 51) == {"median_ms": 2.0, "p99_ms": 2.0}


def test_a_timed_call_gets_its_arguments() -> None:
    seen = []
    assert timed(lambda *values, key: seen.append((values, key)), 1, 2, key=3) >= 0
    assert seen == [((1, 2), 3)]


def test_an_unknown_benchmark_is_refused_with_the_known_names() -> None:
    with pytest.raises(
        InputError, match=f"no benchmark 'speed'; there are {', '.join(BENCHMARKS)}, perception"
    ):
        bench(["speed"])
