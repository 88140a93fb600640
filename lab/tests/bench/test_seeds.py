"""Known seeds against fresh ones: the scores and their difference."""

import pytest

from lab.bench.seeds import SCORED, compare_seeds, score, scored_scenarios
from sim_harness.scenarios.scenario import Scenario

SHORT = Scenario(
    name="short", description="a test", tags=("nominal",), road="straight", duration_s=0.3, sight="truth",
    start={"offset_m": 0.2, "speed_mps": 5},
)  # fmt: skip


@pytest.fixture
def in_this_process(monkeypatch):
    """Without a pool, whose processes would import everything anew."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)


def row(status, error_m):
    return {"status": status, "max_lateral_error_m": error_m}


def test_a_score_is_pass_rate_mean_and_95th_percentile():
    found = score([row("passed", 0.1 * i) for i in range(20)] + [row("failed", 2.0)])
    assert found.runs == 21
    assert found.pass_rate_percent == pytest.approx(100 * 20 / 21)
    assert found.mean_max_lateral_error_m == pytest.approx((0.1 * 190 + 2.0) / 21)
    assert found.pass_rate_error_points == pytest.approx(100 * (20 / 21 / 21 / 21) ** 0.5)
    assert found.p95_max_lateral_error_m == pytest.approx(1.9)


def test_no_runs_have_no_score():
    with pytest.raises(ValueError, match="no runs"):
        score([])


@pytest.mark.usefixtures("in_this_process")
def test_the_same_seeds_score_the_same(tmp_path):
    same = compare_seeds([SHORT], (3, 4), (3, 4), out=tmp_path / "seeds.jsonl")
    assert (same["pass_rate_difference_points"], same["mean_error_difference_percent"]) == (0.0, 0.0)
    assert (same["known_runs"], same["fresh_runs"]) == (2, 2)


@pytest.mark.usefixtures("in_this_process")
def test_a_stored_run_is_not_repeated_and_counts_for_its_seed(tmp_path):
    out = tmp_path / "seeds.jsonl"
    first = compare_seeds([SHORT], (3,), (4,), out=out)
    lines = out.read_text()
    assert lines.count("\n") == 2
    assert compare_seeds([SHORT], (3,), (4,), out=out) == first
    assert out.read_text() == lines


def test_ordinary_driving_is_scored():
    scored = scored_scenarios()
    assert all(SCORED & set(scenario.tags) for scenario in scored)
    assert {"straight", "unmarked_bend", "s_curve"} <= {scenario.name for scenario in scored}
