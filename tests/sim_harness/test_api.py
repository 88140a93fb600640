"""``trepid.run``, ``sweep`` and ``rate`` give what the command line prints."""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import pytest

import trepid
from sim_harness.scenarios.scenario import load_scenario
from trepid.cli import main

SHORT: dict[str, object] = {"duration_s": 2, "sight": "truth"}
WORDS = ["--set", "duration_s=2", "--set", "sight=truth"]


def json_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str
) -> list[dict[str, Any]]:
    """The JSON lines of a command."""
    monkeypatch.setattr(sys, "argv", ["trepid", *words, "--json"])
    assert main() in (0, 1)
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    clock = {"realtime_factor": 0}
    return json.loads(json.dumps(one | clock)) == other | clock


def test_a_run_is_that_of_the_command_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    result = trepid.run("straight", seed=1, settings=SHORT)
    (row,) = json_lines(capsys, monkeypatch, "sim", "run", "straight", "--seed", "1", *WORDS)
    assert same(result.row(), row)
    assert len(result.trace["t_s"]) == len(result.trace)
    again = trepid.run(load_scenario("straight", {"duration_s": "2", "sight": "truth"}), seed=1)
    assert again.trace.sha256 == row["trace_sha256"]


def test_a_sweep_has_the_rows_of_the_command_line_and_stores_them(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    report, out = tmp_path / "runs.html", tmp_path / "runs.jsonl"
    rows = trepid.sweep(["straight", "s_curve"], seeds=2, settings=SHORT, out=out, report=report)
    shown = json_lines(capsys, monkeypatch, "sim", "run", "straight", "s_curve", "--seeds", "2", *WORDS)
    assert len(rows) == 4 and all(map(same, rows, shown))
    assert len(out.read_text().splitlines()) == 4 and "s_curve" in report.read_text()
    again = trepid.sweep(["straight", "s_curve"], seeds=2, settings=SHORT, out=out, resume=True)
    assert all(map(same, again, shown))
    with pytest.raises(trepid.InputError, match="holds results"):
        trepid.sweep("straight", settings=SHORT, out=out)


def test_a_sample_draws_the_cases_of_the_command_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = trepid.sweep("cut_in", sample="lhs", cases=2, seed=5, settings=SHORT)
    words = ["sim", "run", "cut_in", "--sample", "lhs", "--cases", "2", "--seed", "5", *WORDS]
    assert all(map(same, rows, json_lines(capsys, monkeypatch, *words)))
    with pytest.raises(trepid.InputError, match="sample 'cube': expected grid, random, lhs"):
        trepid.sweep("cut_in", sample="cube")


@pytest.fixture(scope="module")
def recorded_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    trepid.run("straight", settings={"duration_s": 3}, record=path)
    return path


def test_a_recording_of_a_run_is_estimated_rated_and_explained(
    recorded_drive: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lanes = list(trepid.estimate(recorded_drive))
    shown = json_lines(capsys, monkeypatch, "estimate", str(recorded_drive))
    assert [one.result.lateral_offset_m for one in lanes] == [row["lateral_offset_m"] for row in shown]
    rated = list(trepid.rate(recorded_drive))
    shown = json_lines(capsys, monkeypatch, "estimate", "--fear", str(recorded_drive))
    assert [one.result.decision.fear for one in rated] == [row["fear"] for row in shown]
    drive = trepid.open_recording(recorded_drive)
    table = drive.table(rate_hz=10)
    assert len(table["fear"]) > 25 and set(drive.estimators) == {"cnn", "cv"}
    assert drive.explain(1.0)["at_s"] == 1.0 == trepid.explain(recorded_drive, at_s=1.0)["at_s"]
    assert drive.slow_downs() == []
    with pytest.raises(trepid.InputError, match="at_s 99"):
        drive.explain(99.0)
    with pytest.raises(trepid.InputError, match="exists already"):
        trepid.run("straight", settings=SHORT, record=recorded_drive)


def test_a_rule_file_is_explained_as_by_the_command_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (row,) = json_lines(capsys, monkeypatch, "fear", "explain", "config/fear.yaml", "speed=8", "time_gap=nan")
    assert trepid.explain("config/fear.yaml", {"speed": 8, "time_gap": None}) == row
    with pytest.raises(trepid.InputError, match="unknown input 'sped'"):
        trepid.explain("config/fear.yaml", {"sped": 8})
    for source in ("config/fear.yaml", trepid.load().rules):
        with pytest.raises(trepid.InputError, match="at_s and rules are for recordings"):
            trepid.explain(source, at_s=1.0)


def test_an_unreadable_image_of_a_folder_is_refused_or_left_out(tmp_path: Path, recorded_drive: Path) -> None:
    image = next(trepid.estimate(recorded_drive)).image
    cv2.imwrite(str(tmp_path / "a.png"), image)
    (tmp_path / "b.png").write_bytes(b"no image")
    with pytest.raises(trepid.InputError, match=r"b\.png"):
        list(trepid.estimate(tmp_path))
    assert len(list(trepid.estimate([tmp_path], strict=False))) == 1
    with pytest.raises(trepid.InputError, match="more than 0 frames per second, got 0"):
        list(trepid.estimate(tmp_path, as_drive=True, fps=0))


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ({"cases": 3}, "cases needs sample"),
        ({"sample": "lhs", "seeds": 2}, "sample draws the seeds itself"),
        ({"seeds": 0}, "seeds 0: at least one expected"),
        ({"resume": True}, "resume needs out"),
        ({"jobs": 0}, "jobs 0: at least 1"),
        ({"cluster": "tcp://127.0.0.1:1", "jobs": 2}, "cluster has its own processes"),
        ({"report": "no/such/folder/r.html"}, "there is no folder no/such/folder"),
    ],
)
def test_a_sweep_whose_parameters_exclude_each_other_is_refused(words: dict[str, Any], reason: str) -> None:
    with pytest.raises(trepid.InputError, match=reason):
        trepid.sweep("cut_in", **words)


def test_parameters_without_an_effect_are_refused() -> None:
    scenario = load_scenario("straight", {})
    with pytest.raises(trepid.InputError, match="not for a Scenario"):
        trepid.run(scenario, settings=SHORT)
    with pytest.raises(trepid.InputError, match="not for a Scenario"):
        trepid.run(scenario, estimators=["cv"])
    for function in (trepid.run, trepid.drive):
        with pytest.raises(trepid.InputError, match="raw_images needs record"):
            function("straight", raw_images=True)
