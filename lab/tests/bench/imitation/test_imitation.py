"""`bench imitation` on a made-up drive and on short simulated ones, and its verdicts on known rows."""

from collections.abc import Callable

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import write_tub

from lab.bench.fear.kinds import DRIVEN as DRIVEN_IN_LANE
from lab.bench.fear.kinds import LEFT, STOPPED
from lab.bench.imitation import bench as module
from lab.bench.imitation import demonstrations, harness
from lab.bench.imitation.bench import OURS, PEER, SETS, bench_imitation
from lab.bench.imitation.verdict import (
    AUTONOMY,
    DEPARTURES,
    DRIVEN,
    EXACT,
    FARTHEST,
    KINDS,
    SHIFTED,
    judge_simulation,
    verdicts,
)
from sim_harness.scenarios.scenario import Scenario
from trepid.config import InputError

BLIND = {"always_straight": {"mae_deg": 5.0}, "mean": {"mae_deg": 4.0}}


def row(mae_deg: float, *, r2: float = 0.7, coverage: float = 0.9) -> dict:
    return {"mae_deg": mae_deg, "r2": r2, "coverage_90": coverage}


def verdict(mine: dict, peer_deg: float, name: str = "donkey_sim_carpet") -> dict:
    table = {name: {"steer": mine, PEER: row(peer_deg), **BLIND, "previous_200ms": {"mae_deg": 0.1}}}
    return verdicts(table, ("steer",), PEER)[f"{name}, steer"]


@pytest.fixture
def drive(tmp_path, monkeypatch):
    """The folder of sets with one short drive."""
    monkeypatch.setattr(module, "FOLDER", tmp_path / "out")
    write_tub(tmp_path / "data" / SETS[0])
    return tmp_path / "data"


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the ONNX export in torch
def test_a_drive_is_learned_once_and_its_rows_are_used_again(drive, monkeypatch):
    found = bench_imitation(seed=1, quick=True, data=drive, sets=SETS)
    rows = found["last fifth"][SETS[0]]
    assert {*OURS, PEER, "always_straight", "mean", "previous_200ms"} == rows.keys()
    for network in (*OURS, PEER):
        assert 0 < rows[network]["mae_deg"] < 90 and rows[network]["epochs"] == 2
        assert rows[network]["latency_ms"] > 0 and 0 <= rows[network]["coverage_90"] <= 1
    assert found[SETS[1]] == {"left out": f"no folder {SETS[1]} in the data folder"}
    monkeypatch.setattr(module, "judge_training", None)  # nothing is trained again
    assert bench_imitation(seed=1, quick=True, data=drive, sets=SETS) == found


def on_a_short_way(load: Callable[..., Scenario]) -> Callable[..., Scenario]:
    """``load``, whose last argument is the changes of a scenario, with 60 m to drive, from just before the bend."""
    return lambda *words: load(
        *words[:-1], {**words[-1], "start.station_m": "50", "distance_m": "60", "duration_s": "12"}
    )


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the ONNX export in torch
def test_networks_learn_from_random_roads_and_drive_on_others(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    monkeypatch.setattr(demonstrations, "UNSEEN", {"s_curve": {"start.station_m": "50", "distance_m": "30"}})
    monkeypatch.setattr(harness, "NETWORKS", {name: {} for name in (harness.DRIVER, "steer-lstm")})
    monkeypatch.setattr(harness, "QUICK_ROADS", 3)
    monkeypatch.setattr(harness, "QUICK_SCENARIOS", ("unmarked_bend",))
    for load in ("load_scenario", "scenario_for"):  # into the bend, not to the end of the road
        monkeypatch.setattr(harness, load, on_a_short_way(getattr(harness, load)))
    found = bench_imitation(seed=1, quick=True, sets=(module.HARNESS,))
    row = found["unseen roads"][harness.DRIVER]
    assert row["frames"] > 50 and 0 < row["mae_deg"] < 90 and row["weights"] < 300_000
    assert 0 <= row["coverage_90_random"] <= 1 and row["mae_beyond_40_deg"] > 0
    assert found["unseen roads"]["always_straight"]["mae_deg"] > 10
    assert found["unseen roads"]["mean"]["mae_deg"] > 10
    assert all(0 <= share <= 1 for row in found[SHIFTED].values() for share in row.values())
    for table in (AUTONOMY, FARTHEST, DEPARTURES, DRIVEN):
        assert found[table]["unmarked_bend"].keys() == {"20 mph"}
    for driver in ("alone", "supervised beside cv and cnn"):
        ended = found[KINDS][f"{driver}, 20 mph"]
        assert ended[DRIVEN_IN_LANE] + ended[STOPPED] + ended[LEFT] == 1
    assert found[KINDS]["alone, 20 mph"]["farthest [m]"] == pytest.approx(
        found[FARTHEST]["unmarked_bend"]["20 mph"], abs=0.01
    )
    assert found[EXACT.format(20)]["unmarked_bend"]["autonomy_percent"] == 100
    for name in ("demonstrate", "judge_training", "drive_network"):  # nothing is done again
        monkeypatch.setattr(demonstrations if name == "demonstrate" else harness, name, None)
    assert bench_imitation(seed=1, quick=True, sets=(module.HARNESS,)) == found


def tables(
    *,
    mae_deg: float = 1.4,
    slower: float = 0.4,
    autonomy: float = 100.0,
    departures: int = 0,
    covered: float = 0.9,
) -> dict:
    network = {
        "mae_deg": mae_deg,
        "mae_random_deg": mae_deg,
        "mae_beyond_40_deg": 2.9,
        "r2": 0.995,
        "weights": 200_000,
        "latency_ms": 0.5,
        "coverage_90": 0.95,
        "coverage_90_random": 0.9,
        "rate_rms_degps": 20.0,
    }
    sequence = network | {"rate_rms_degps": slower * 20.0}
    worse = network | {"mae_random_deg": 9.0, "weights": 900_000}
    return {
        "unseen roads": {
            "donkey-linear": worse,
            "steer": network,
            "steer-lstm": sequence,
            "always_straight": {"mae_deg": 1.0},
        },
        FARTHEST: {"straight": {"5 mph": 0.8}, "driveways": {"5 mph": 0.1, "10 mph": 0.2}},
        AUTONOMY: {"straight": {"5 mph": 100.0, "10 mph": autonomy}},
        DEPARTURES: {"straight": {"5 mph": 0, "10 mph": departures}},
        SHIFTED: {shift: {"donkey-linear": 0.1, "steer": covered} for shift in ("rain", "snow")},
    }


def test_the_aims_of_the_simulator_are_those_of_the_best_network_and_of_every_drive():
    assert {row["is"] for row in judge_simulation(tables()).values()} == {"met"}
    assert judge_simulation(tables())["farthest at branches [m]"]["measured"] == 0.2
    for missed, found in (
        ("mae_deg of steer", tables(mae_deg=1.6)),
        ("steering rate, steer-lstm to steer", tables(slower=0.6)),
        ("least autonomy alone [%]", tables(autonomy=99.0)),
        ("departures supervised", tables(departures=1)),
        ("coverage_90 of steer under its worst shift, rain", tables(covered=0.8)),
    ):
        assert [name for name, row in judge_simulation(found).items() if row["is"] == "missed"] == [missed]


def test_an_unknown_set_is_refused_with_the_names_of_the_others():
    with pytest.raises(
        InputError, match="no set 'carpet' in bench imitation; there are harness, donkey_sim_carpet, "
    ):
        bench_imitation(seed=1, sets=("carpet",))


def test_an_error_is_compared_with_the_peer_and_with_predictions_without_an_image():
    met, missed = verdict(row(3.2), 4.0), verdict(row(3.3), 4.0)
    assert (met["at_most_0.8"], missed["at_most_0.8"]) == ("met", "missed")
    assert met["error_to_blind"] == pytest.approx(0.8) and met["below_1"] == "met"
    assert verdict(row(4.1), 9.0)["below_1"] == "missed"


def test_a_simulated_drive_needs_more_of_its_angles_explained():
    assert verdict(row(1.0, r2=0.5), 4.0)["r2_enough"] == "missed"
    assert verdict(row(1.0, r2=0.5), 4.0, "running_track_cart")["r2_enough"] == "met"
    assert verdict(row(1.0, r2=0.0), 4.0, "running_track_cart")["r2_enough"] == "missed"


def test_an_interval_may_cover_neither_too_little_nor_too_much():
    coverages = (0.88, 0.89, 0.91, 0.92)
    found = [verdict(row(1.0, coverage=one), 4.0)["within_0.015"] for one in coverages]
    assert found == ["missed", "met", "met", "missed"]
