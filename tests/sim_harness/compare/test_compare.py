"""``trepid compare``: two recordings, or two files of stored runs."""

import json
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from drive_rig import run
from recorded_rig import record_drive

from cockpit.logbook.recall import recall
from sim_harness.compare.drives import first_difference
from sim_harness.scenarios.scenario import load_scenario
from trepid.clock import seconds
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording
from trepid.topics import DECISION
from trepid.wire import to_cdr

RUN = {"scenario": "circuit", "seed": 0, "status": "passed", "max_fear": 0.25, "realtime_factor": 3.0}
HUGE = '{"scenario": "x", "seed": 1e400, "status": "passed"}\n'


@pytest.fixture
def compare(capsys: pytest.CaptureFixture[str]) -> Any:
    return lambda *words: (run("compare", *map(str, words)), *capsys.readouterr())


def store_runs(path: Path, *runs: dict[str, Any]) -> Path:
    path.write_text("".join(json.dumps(run) + "\n" for run in runs))
    return path


def test_changed_status_and_figures_of_runs_are_listed_without_the_speed_of_the_machine(
    tmp_path: Path, compare: Any
) -> None:
    a = store_runs(tmp_path / "a.jsonl", RUN, RUN | {"seed": 1})
    b = store_runs(
        tmp_path / "b.jsonl",
        RUN | {"status": "failed", "max_fear": 0.5},
        RUN | {"seed": 1, "realtime_factor": 9.0},
        RUN | {"seed": 2},
    )
    code, out, _ = compare(a, b, "--json")
    found = json.loads(out)
    changed = {"status": ["passed", "failed"], "max_fear": [0.25, 0.5]}
    assert code == 0
    assert found["changed"] == [{"scenario": "circuit", "seed": 0, "changed": changed}]
    assert (found["compared"], found["only_a"], found["only_b"]) == (2, [], ["circuit seed 2"])


@pytest.mark.parametrize("text", ["", "[1]\n", '{"scenario": "x"}\n', "no json\n", HUGE])
def test_a_file_without_runs_is_refused_in_one_line(tmp_path: Path, compare: Any, text: str) -> None:
    bad = tmp_path / "bad.jsonl"
    bad.write_text(text)
    code, out, err = compare(store_runs(tmp_path / "a.jsonl", RUN), bad)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "bad.jsonl" in err


def test_a_recording_is_not_compared_with_runs(tmp_path: Path, compare: Any) -> None:
    drive = tmp_path / "d.mcap"
    drive.write_bytes(b"\x89MCAP")
    code, _, err = compare(drive, store_runs(tmp_path / "a.jsonl", RUN))
    assert code == 2
    assert "two of a kind" in err


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    scenario = load_scenario("straight", {"duration_s": "3"})
    return record_drive(path, scenario)


def test_a_recording_does_not_differ_from_itself_and_both_are_drawn(
    drive: Path, tmp_path: Path, compare: Any
) -> None:
    picture = tmp_path / "both.png"
    code, out, _ = compare(drive, drive, "--json", "--picture", picture)
    found = json.loads(out)
    assert code == 0
    assert found["first_difference"] is None and found["equal"]
    assert "No decision differs" in compare(drive, drive)[1]
    assert {row["change"] for row in found["figures"]} == {0.0}
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_first_difference_is_the_first_changed_decision(drive: Path) -> None:
    one = recall(drive)
    changed = copy(one.decisions)
    changed.keep(range(len(changed)))  # its own list of messages
    for k in (60, 65):
        changed.data[k] = to_cdr(replace(one.decisions[k], fear=0.75))
    other = replace(one, series={**one.series, DECISION.key: changed})
    fear = one.decisions[60].fear
    at_s = round(float(one.t_s[60]), 3)
    assert first_difference(one, other) == {"t_s": at_s, "fields": {"fear": [fear, 0.75]}}


def part(drive: Path, out: Path, *, from_s: float = -10.0, to_s: float = 10.0) -> Path:
    """The messages of ``drive`` in a part of its time."""
    held = read_recording(drive)
    assert held.began_s is not None
    with Recording(out, held.files, held.notes) as file:
        for log_ns, key, data in in_order(drive):
            if from_s <= seconds(log_ns) - held.began_s < to_s:
                file.add(key, data, at_s=seconds(log_ns))
    return out


def test_recordings_without_a_common_time_are_not_equal(drive: Path, tmp_path: Path, compare: Any) -> None:
    one, other = part(drive, tmp_path / "a.mcap", to_s=1.0), part(drive, tmp_path / "b.mcap", from_s=2.0)
    found = json.loads(compare(one, other, "--json")[1])
    assert found["first_difference"] is None and not found["equal"] and found["common_s"] is None
    assert "there is no common time: A has decisions from" in compare(one, other)[1]


@pytest.mark.parametrize("swapped", [False, True])
def test_a_recording_that_ends_earlier_is_equal_in_the_common_time_only(
    drive: Path, tmp_path: Path, compare: Any, swapped: bool
) -> None:
    paths = [drive, part(drive, tmp_path / "cut.mcap", to_s=1.0)]
    one, other = reversed(paths) if swapped else paths
    found = json.loads(compare(one, other, "--json")[1])
    ends_s = sorted(last_s for _, last_s in found["spans_s"])
    assert found["first_difference"] is None and not found["equal"]
    assert found["common_s"] == [found["spans_s"][0][0], ends_s[0]] and ends_s[0] < 1.0 < ends_s[1]
    assert "No decision of the common" in compare(one, other)[1]


def test_a_folder_with_a_recording_that_ends_earlier_differs(
    drive: Path, tmp_path: Path, compare: Any
) -> None:
    for name, to_s in (("a", 10.0), ("b", 1.0)):
        (tmp_path / name).mkdir()
        part(drive, tmp_path / name / "drive.mcap", to_s=to_s)
    assert "1 pairs compared, 1 differ" in compare(tmp_path / "a", tmp_path / "b")[1]
    assert "1 pairs compared, 0 differ" in compare(tmp_path / "a", tmp_path / "a")[1]
