"""The figures of ``trepid bench logbook``: what they measure, on few and short recordings."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lab.bench.logbook import bench, crash
from lab.bench.logbook.bench import measure_answers, measure_replay, measure_start
from lab.bench.logbook.crash import cut, kill_writers, readable_bytes
from lab.bench.logbook.drives import endless, prolong, record_run
from sim_harness.scenarios.scenario import load_scenario
from trepid.recording.reader import read_recording
from trepid.topics import DECISION


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = load_scenario("straight", {"sight": "truth", "duration_s": "6"})
    return record_run(scenario, tmp_path_factory.mktemp("drive") / "drive.mcap", seed=1)


@pytest.mark.long
def test_random_moments_of_every_kind_of_recording_are_answered(tmp_path: Path) -> None:
    row = measure_answers(tmp_path, 3, np.random.default_rng(1))
    assert row["moments"] == 60 and row["answered [%]"] == 100.0
    assert [row[f"answered, {kind} recordings [%]"] for kind in ("whole", "part", "cut")] == [100.0] * 3


def test_a_prolonged_recording_repeats_its_messages_with_later_stamps(drive: Path, tmp_path: Path) -> None:
    long = read_recording(prolong(drive, tmp_path / "long.mcap", 40.0), DECISION.key)
    once = read_recording(drive, DECISION.key)
    stamps = [decision.t_s for _, decision in long.of(DECISION) if decision.t_s is not None]
    assert all(later >= earlier for earlier, later in pairwise(stamps))
    assert len(long.of(DECISION)) > 3 * len(once.of(DECISION))
    assert long.last_s - long.first_s == pytest.approx(40.0, abs=0.2)
    first = [entry for entry, _ in zip(endless(drive), range(3), strict=False)]
    assert first[0][2] == once.first_s


@pytest.mark.long
def test_a_killed_writer_leaves_what_it_wrote_but_for_less_than_half_a_second(
    drive: Path, tmp_path: Path
) -> None:
    row = kill_writers(drive, tmp_path, 2, np.random.default_rng(2))
    assert row["not readable"] == 0
    assert row["end of the drive that is lost, most [s]"] < 0.5
    assert 90.0 < row["messages readable of those written, least [%]"] <= 100.0
    assert not list(tmp_path.iterdir())


def test_a_cut_recording_is_readable_up_to_its_last_whole_record(drive: Path, tmp_path: Path) -> None:
    data = drive.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(data[: len(data) // 2])
    assert len(data) // 2 - 100_000 < readable_bytes(torn) <= len(data) // 2
    assert readable_bytes(drive) >= len(data) - 8  # the end mark
    row = cut(prolong(drive, tmp_path / "long.mcap", 60.0), tmp_path, 5, np.random.default_rng(3))
    assert row["not readable"] == 0 and row["bytes readable, least [%]"] < 100.0


@pytest.fixture
def broken_file(tmp_path: Path) -> Path:
    path = tmp_path / "broken.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(500))
    return path


def test_recordings_that_are_not_readable_are_counted_with_nothing_left(
    drive: Path, broken_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = iter([broken_file.read_bytes(), drive.read_bytes(), b""])

    def leave(_: Path, path: Path, __: float) -> tuple[int, float]:
        path.write_bytes(next(files))
        return 10_000, 100.0

    monkeypatch.setattr(crash, "_killed_while_writing", leave)
    row = kill_writers(drive, tmp_path, 3, np.random.default_rng(2))
    assert (row["recordings"], row["not readable"]) == (3, 2)
    assert row["messages readable of those written, least [%]"] == 0.0
    assert row["length of the drive, median [s]"] is not None
    row = cut(broken_file, tmp_path, 2, np.random.default_rng(2))
    assert (row["not readable"], row["bytes readable, mean [%]"]) == (2, 0.0)


def test_the_moments_of_a_recording_that_is_not_readable_have_no_answer(
    drive: Path, broken_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "random_recordings", lambda *_: [("whole", drive), ("cut", broken_file)])
    row = measure_answers(tmp_path, 2, np.random.default_rng(1))
    assert (row["not readable"], row["moments"], row["answered [%]"]) == (1, 40, 50.0)
    monkeypatch.setattr(bench, "random_recordings", lambda *_: [("cut", broken_file)])
    assert measure_answers(tmp_path, 1, np.random.default_rng(1))["answered [%]"] == 0.0


@pytest.mark.long
def test_opening_and_replay_are_timed(drive: Path) -> None:
    assert measure_start(drive)["decisions"] == len(read_recording(drive, DECISION.key).of(DECISION))
    row = measure_replay(drive)
    assert row["outputs that differ"] == 0 and row["outputs compared"] > 300
