"""The benchmark of the plants counts executed steps and leaves out peers that are not installed."""

import sys

import pytest

from lab.bench import plants as bench


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """One turn of some milliseconds each: the test is of the bookkeeping."""
    monkeypatch.setattr(bench, "TURN_S", 0.003)
    monkeypatch.setattr(bench, "TURNS", 1)
    monkeypatch.setattr(bench, "BATCH", 50)


def test_ours_and_commonroads_models_are_measured_in_one_run(monkeypatch):
    pytest.importorskip(
        "vehiclemodels", reason="commonroad-vehicle-models is in the extras [test] and [bench]"
    )
    monkeypatch.setitem(sys.modules, "highway_env", None)
    with pytest.warns(UserWarning, match="left out: .*(highway_env|gymnasium)"):
        rows = bench.bench_plants()
    assert {"kinematic", "single_track", "kinematic_batch_of_50"} < set(rows)
    assert rows[bench.PEER][f"ratio_to_{bench.PEER}"] == 1.0
    assert "highway_env_lane_keeping" not in rows
    assert rows["peers"]["commonroad-vehicle-models"] == "3.0.2"


def test_a_step_of_the_batch_counts_for_each_vehicle_and_no_peer_means_no_ratio(monkeypatch):
    monkeypatch.setitem(sys.modules, "vehiclemodels.init_mb", None)
    monkeypatch.setitem(sys.modules, "highway_env", None)
    monkeypatch.setattr(bench, "steps_per_s", lambda advance: 10.0)
    with pytest.warns(UserWarning, match="left out"):
        rows = bench.bench_plants()
    assert rows["kinematic"] == {"steps_per_s": 10}
    assert rows["kinematic_batch_of_50"] == {"steps_per_s": 500}


def test_every_contestant_moves_its_vehicle():
    """A counted step moves the vehicle: without motion the rate would have no meaning."""
    calls = []
    assert bench.steps_per_s(calls.append) > 0
    assert calls == list(range(len(calls)))
    assert len(calls) > 1
