"""The ``bench`` verb runs known benchmarks, refuses others, and stores results with ``--save``."""

import json
from pathlib import Path

import pytest

import sim_harness.lockstep.closed_loop
from lab.bench import cli
from lab.bench.catalogue import BENCHMARKS, BY_DEFAULT, function, names_of
from lab.bench.cli import bench, taken_options
from lab.bench.frames import summary_ms, time_call
from lab.bench.results import machine
from trepid.config import CONFIG_DIR, InputError


def test_the_machine_is_stated_with_load_and_versions() -> None:
    stated = machine()
    assert "cores" in stated["machine"]
    assert len(stated["load_average"]) == 3
    assert all(stated["versions"].values())


def test_the_summary_is_the_median_and_the_99th_percentile_in_milliseconds() -> None:
    assert summary_ms([0.001] * 50 + [0.002] * 51) == {"median_ms": 2.0, "p99_ms": 2.0}


def test_a_timed_call_gets_its_arguments() -> None:
    calls = []
    assert time_call(lambda *values, key: calls.append((values, key)), 1, 2, key=3) >= 0
    assert calls == [((1, 2), 3)]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_of_the_catalogue_exists(name: str) -> None:
    assert callable(function(name))


def test_every_benchmark_takes_its_options_and_an_option_of_none_is_refused() -> None:
    assert set(BY_DEFAULT) <= set(BENCHMARKS)
    assert taken_options(["plants", "fear-fuzz"], {}, seed=3) == {"plants": {}, "fear-fuzz": {"seed": 3}}
    both = taken_options(["plants", "perception"], {"keep_frames": True}, seed=3)
    assert both == {"plants": {}, "perception": {"seed": 3, "keep_frames": True}}
    with pytest.raises(InputError, match="--keep-frames is no option of bench renderer, plants"):
        bench(["renderer", "plants"], keep_frames=True)


def test_a_bad_configuration_is_refused_with_its_place_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (CONFIG_DIR / "camera.yaml").read_text(encoding="utf-8")
    (tmp_path / "camera.yaml").write_text(text.replace("height_m:", "heigth_m:"), encoding="utf-8")
    monkeypatch.setattr(sim_harness.lockstep.closed_loop, "CONFIG_DIR", tmp_path)
    monkeypatch.setattr(cli, "function", lambda _name: fail_measuring)
    with pytest.raises(InputError, match=r"camera.yaml:\d+:\d+: .*heigth_m"):
        bench(["plants"])


def fail_measuring(seed: int) -> dict[str, object]:
    pytest.fail("measured")


def test_a_group_stands_for_its_members_without_those_of_half_an_hour() -> None:
    assert "control-mpc" in names_of("control")
    assert "control-limits" not in names_of("control")
    assert names_of("plants") == ["plants"]


def test_an_unknown_benchmark_is_refused_with_the_known_names() -> None:
    with pytest.raises(InputError, match=r"no benchmark 'speed'; did you mean .*--list"):
        bench(["speed"])


def test_a_result_is_saved_as_rows_page_and_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = {"ours": {"error [m]": 0.0123456, "lost": 0}, "theirs": {"error [m]": 0.5, "lost": None}}
    monkeypatch.setattr(cli, "function", lambda _name: lambda seed: {"seed of the cases": seed, **rows})
    assert bench(["control-lateral"], seed=7, save_in=tmp_path, as_json=True) == 0
    assert json.loads(capsys.readouterr().out)["control-lateral"]["ours"] == rows["ours"]
    assert json.loads((tmp_path / "control-lateral.json").read_text())["measured"]["theirs"] == rows["theirs"]
    page = (tmp_path / "README.md").read_text()
    assert "`trepid bench control-lateral --seed 7`" in page
    assert "| ours | 0.01235 | 0 |" in page
    assert "| theirs | 0.5 | – |" in page
    assert (tmp_path / "control-lateral.png").stat().st_size > 1000


def test_a_folder_that_is_not_there_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "function", lambda _name: fail_measuring)
    with pytest.raises(InputError, match="there is no such folder"):
        bench(["plants"], save_in=tmp_path / "no")
