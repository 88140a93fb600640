"""``trepid compare``: traces, folders, and the page of a comparison."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drive_rig import run
from recorded_rig import record_drive

import trepid
from sim_harness.compare.page import unit_of
from sim_harness.compare.traces import compare_traces
from sim_harness.judging.trace import Trace
from sim_harness.scenarios.scenario import load_scenario

SCENARIO = load_scenario("straight", {"duration_s": "2", "sight": "truth"})


@pytest.fixture
def compare(capsys: pytest.CaptureFixture[str]) -> Any:
    return lambda *words: (run("compare", *map(str, words)), *capsys.readouterr())


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording and the trace of the same run."""
    folder = tmp_path_factory.mktemp("drives")
    record_drive(folder / "run.mcap", SCENARIO, trace=folder / "run.npz")
    return folder


def change_trace(trace: Trace, name: str, at: int, value: float) -> Trace:
    column = trace[name].copy()
    column[at] = value
    return Trace({**trace.columns, name: column}, trace.words)


def test_equal_traces_have_the_same_hash_and_no_first_difference(drives: Path, compare: Any) -> None:
    code, out, _ = compare(drives / "run.npz", drives / "run.npz", "--json")
    found = json.loads(out)
    assert code == 0 and found["equal"] and found["first_difference"] is None
    assert found["trace_sha256"] == [Trace.load(drives / "run.npz").sha256] * 2
    assert {row["change"] for row in found["figures"]} <= {0.0, None}
    assert found["trace_sha256"][0] in compare(drives / "run.npz", drives / "run.npz")[1]


@pytest.mark.parametrize(("name", "value"), [("speed_mps", 3.25), ("decision.fear", np.nan), ("mode", -1.0)])
def test_the_first_sample_that_differs_is_named_with_both_values(
    drives: Path, tmp_path: Path, name: str, value: float
) -> None:
    trace = Trace.load(drives / "run.npz")
    change_trace(change_trace(trace, name, 150, value), "x_m", 160, -1.0).save(tmp_path / "b.npz")
    found, _ = compare_traces(drives / "run.npz", tmp_path / "b.npz")
    word = trace.words["mode"][int(trace["mode"][150])]
    before = word if name == "mode" else trace[name][150]
    after = value if name == "speed_mps" else None
    at_s = round(float(trace["t_s"][150] - trace["t_s"][0]), 3)
    assert not found["equal"]
    assert found["first_difference"] == {"t_s": at_s, "fields": {name: [before, after]}}


def test_a_shorter_trace_is_not_equal_although_no_common_sample_differs(drives: Path, tmp_path: Path) -> None:
    trace = Trace.load(drives / "run.npz")
    Trace({name: column[:-5] for name, column in trace.columns.items()}, trace.words).save(tmp_path / "b.npz")
    found, _ = compare_traces(drives / "run.npz", tmp_path / "b.npz")
    assert not found["equal"] and found["first_difference"] is None
    assert found["samples"][0] - found["samples"][1] == 5


@pytest.mark.parametrize("name", ["run.npz", "run.mcap", ""])
def test_the_function_gives_what_the_verb_prints(drives: Path, compare: Any, name: str) -> None:
    _, out, _ = compare(drives / name, drives / name, "--json")
    assert trepid.compare(drives / name, drives / name) == json.loads(out)


def test_folders_are_compared_file_by_file_of_the_same_name(
    drives: Path, tmp_path: Path, compare: Any
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "run.mcap").write_bytes((drives / "run.mcap").read_bytes())
    change_trace(Trace.load(drives / "run.npz"), "speed_mps", 100, 9.0).save(other / "run.npz")
    (other / "more.npz").write_bytes((drives / "run.npz").read_bytes())
    code, out, _ = compare(drives, other, "--json")
    found = json.loads(out)
    assert code == 0 and found["only_a"] == [] and found["only_b"] == ["more.npz"]
    assert [(pair["name"], pair["first_difference"] is None) for pair in found["pairs"]] == [
        ("run.mcap", True),
        ("run.npz", False),
    ]
    assert "2 pairs compared, 1 differ" in compare(drives, other)[1]


def test_folders_of_stored_runs_are_compared_by_scenario_and_seed(tmp_path: Path, compare: Any) -> None:
    row = {"scenario": "circuit", "seed": 0, "status": "passed", "trace_sha256": "a" * 64}
    for name, digest in (("a", "a" * 64), ("b", "b" * 64)):
        (tmp_path / name).mkdir()
        lines = [row | {"trace_sha256": digest}, row | {"seed": 1}]
        (tmp_path / name / "runs.jsonl").write_text("".join(json.dumps(one) + "\n" for one in lines))
    _, out, _ = compare(tmp_path / "a", tmp_path / "b", "--json")
    found = json.loads(out)
    assert (found["compared"], found["equal_traces"], len(found["changed"])) == (2, 1, 1)


@pytest.mark.parametrize("one", ["run.mcap", "run.npz"])
def test_the_page_shows_figures_with_unit_and_meaning_and_loads_nothing(
    drives: Path, tmp_path: Path, compare: Any, one: str
) -> None:
    page = tmp_path / "both.html"
    code, out, _ = compare(drives / one, drives / one, "--report", page, "--json")
    assert code == 0
    text, figures = page.read_text(), json.loads(out)["figures"]
    HTMLParser().feed(text)
    assert "default-src 'none'" in text and not re.search(r'(src|href)="(?!data:)', text)
    rows = re.findall(r"<tr>(.*?)</tr>", text)
    cells = {found[0]: found for row in rows if (found := re.findall(r"<td[^>]*>(.*?)</td>", row))}
    assert set(cells) == {row["name"] for row in figures}
    assert all(row[4] == unit_of(row[0]) and row[5] for row in cells.values())
    assert text.count("data:image/png") == 1
    code, _, err = compare(drives / one, drives / one, "--report", page)
    assert code == 2 and "exists already" in err


def test_the_page_of_stored_runs_shows_what_changed(tmp_path: Path, compare: Any) -> None:
    row = {"scenario": "a<b", "seed": 0, "status": "passed", "max_fear": 0.25}
    for name, fear in (("a.jsonl", 0.25), ("b.jsonl", 0.5)):
        (tmp_path / name).write_text(json.dumps(row | {"max_fear": fear}) + "\n")
    page = tmp_path / "p.html"
    assert compare(tmp_path / "a.jsonl", tmp_path / "b.jsonl", "--report", page)[0] == 0
    assert "a&lt;b seed 0" in page.read_text() and "+0.25" in page.read_text()


@pytest.mark.parametrize("words", [["--picture", "p.png"], []])
def test_what_cannot_be_compared_or_drawn_is_refused_in_one_line(
    drives: Path, tmp_path: Path, compare: Any, words: list[str]
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    pair = (drives, drives) if words else (drives, empty)
    code, out, err = compare(*pair, *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    code, _, err = compare(drives / "run.npz", drives / "run.mcap")
    assert code == 2 and "traces and recordings cannot be compared" in err


def without(*names: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda arrays: {name: array for name, array in arrays.items() if name not in names}


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (without("decision.fear"), "it has no column decision.fear"),
        (without("words.mode"), "it has no column words.mode"),
        (lambda arrays: arrays | {"speed_mps": arrays["speed_mps"][:-1]}, "speed_mps is no column of"),
        (lambda arrays: arrays | {"x_m": arrays["x_m"].astype(str)}, "x_m is no column of"),
        (lambda arrays: arrays | {"mode": arrays["mode"] + 90.0}, "mode has a code without a word"),
        (
            lambda arrays: {n: a if n.startswith("words.") else a[:1] for n, a in arrays.items()},
            "a trace of 1 samples over 0.0 s cannot be scored",
        ),
    ],
)
def test_a_file_of_arrays_that_is_no_trace_to_compare_is_refused_with_what_is_wrong(
    drives: Path, tmp_path: Path, compare: Any, change: Callable[[dict[str, Any]], dict[str, Any]], fault: str
) -> None:
    with np.load(drives / "run.npz") as saved:
        np.savez(tmp_path / "bad.npz", **change(dict(saved)))
    code, out, err = compare(drives / "run.npz", tmp_path / "bad.npz")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "bad.npz: " in err and fault in err


@pytest.mark.parametrize("damage", ["an array", "a byte"])
def test_an_array_alone_and_a_damaged_trace_are_refused(
    drives: Path, tmp_path: Path, compare: Any, damage: str
) -> None:
    path = tmp_path / "bad.npz"
    data = (drives / "run.npz").read_bytes()
    if damage == "an array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    else:
        path.write_bytes(data[:3000] + bytes(200) + data[3200:])
    code, out, err = compare(drives / "run.npz", path)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "bad.npz: is no saved trace" in err


def test_a_pair_of_traces_of_different_lengths_counts_as_one_that_differs(
    drives: Path, tmp_path: Path, compare: Any
) -> None:
    trace = Trace.load(drives / "run.npz")
    Trace({name: column[:-5] for name, column in trace.columns.items()}, trace.words).save(
        tmp_path / "run.npz"
    )
    assert "1 pairs compared, 1 differ" in compare(drives, tmp_path)[1]
