"""`bench imitation` on a made-up drive, and its verdicts on known rows."""

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import write_tub

from sim_harness.bench.imitation import bench as module
from sim_harness.bench.imitation.bench import OURS, PEER, SETS, bench_imitation
from sim_harness.bench.imitation.verdict import verdicts
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
    found = bench_imitation(quick=True, data=drive)
    rows = found["last fifth"][SETS[0]]
    assert {*OURS, PEER, "always_straight", "mean", "previous_200ms"} == rows.keys()
    for network in (*OURS, PEER):
        assert 0 < rows[network]["mae_deg"] < 90 and rows[network]["epochs"] == 2
        assert rows[network]["latency_ms"] > 0 and 0 <= rows[network]["coverage_90"] <= 1
    assert found[SETS[1]] == {"left out": f"no folder {SETS[1]} in the data folder"}
    monkeypatch.setattr(module, "judged", None)  # nothing is trained again
    assert bench_imitation(quick=True, data=drive) == found


def test_an_unknown_set_is_refused_with_the_names_of_the_others():
    with pytest.raises(InputError, match="no set 'carpet' in bench imitation; there are donkey_sim_carpet, "):
        bench_imitation(sets=("carpet",))


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
