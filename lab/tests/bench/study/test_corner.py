"""The study of the corner: its roads, the mirrored drive at the rate of the training, scores and medians."""

from types import SimpleNamespace

import numpy as np
import pytest

from lab.bench.imitation.demonstrations import RATE_HZ, SPEED_MPS
from lab.bench.study import corner as study
from lab.bench.study.corner import NETWORKS, RADII_M, corner, corner_road, drive, tables
from learning.models.catalogue import MODELS
from sim_harness.world.roads.appearance import Stroke


def test_the_roads_bend_to_either_side_by_the_studied_radii_and_have_lines():
    roads = [corner_road(np.random.default_rng((1, number))) for number in range(30)]
    bends = np.array([road.curvature_at(road.length_m - 75.0 - 20.0) for road in roads])
    tightest = np.array([road.max_curvature_1pm for road in roads])
    assert ((1 / tightest >= RADII_M[0]) & (1 / tightest <= RADII_M[1])).all()
    assert {-1.0, 1.0} <= set(np.sign(bends[bends != 0]))
    strokes = [(one.left.stroke, one.right.stroke) for road in roads for one in road.sections]
    assert all(set(pair) != {Stroke.NONE} for pair in strokes)


def test_the_judged_corner_is_that_of_the_scenario_to_either_side_at_the_rate_of_the_training(tmp_path):
    (tmp_path / "net.onnx").touch()
    left, right = (corner(tmp_path / "net.onnx", 0.3, side) for side in (1, -1))
    assert (left.speed_mps, left.camera.rate_hz, left.start.offset_m) == (SPEED_MPS, RATE_HZ, 0.3)
    for one, other in zip(left.segments, right.segments, strict=True):
        assert np.array_equal(np.array(one.curvature_1pm), -np.array(other.curvature_1pm))
    assert left.estimators == ("net",)


def test_the_errors_in_the_corner_and_after_it_are_apart(monkeypatch: pytest.MonkeyPatch):
    trace = {
        "station_m": np.array([0.0, 34.0, 40.0, 60.0, 66.0, 90.0]),
        "lateral_offset_m": np.array([0.3, 0.2, -0.15, 0.1, 0.05, -0.08]),
    }
    metrics = SimpleNamespace(rms_lateral_error_m=0.1234, departures=2, interventions=1)
    result = SimpleNamespace(trace=trace, metrics=metrics)
    monkeypatch.setattr(study, "drive_alone", lambda scenario, *, seed: result)
    row = drive(None)  # type: ignore[arg-type]
    assert row == {
        "in the corner [m]": 0.15,
        "after it [m]": 0.08,
        "rms [m]": 0.123,
        "departures": 2,
        "interventions": 1,
    }


def test_a_network_is_scored_by_the_median_of_its_trainings():
    rows = {f"{name}, training {n}": {"rms [m]": 0.1 * (n + 1)} for name in NETWORKS for n in range(3)}
    found = tables(rows)["median of the trainings"]
    assert found == {name: {"rms [m]": 0.2} for name in NETWORKS}


def test_a_network_with_a_memory_stands_beside_one_of_a_single_frame():
    kinds = {MODELS[network].recurrent for network, _ in NETWORKS.values()}
    assert kinds == {True, False}
