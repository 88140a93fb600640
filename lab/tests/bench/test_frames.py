"""The time of `segments` stands beside that of the bare session of its network."""

from pathlib import Path

import numpy as np
import pytest
from segment_rig import write_network_of_car

from lab.bench.frames import BARE, SEGMENTS, _beside_session, bench_segments
from trepid.config import InputError


def test_segments_and_the_bare_session_of_its_network_are_timed_on_the_same_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network_of_car(tmp_path)
    monkeypatch.setenv("TREPID_CAR", str(tmp_path))
    rows = bench_segments(frames=3)
    assert list(rows) == [SEGMENTS, BARE] and rows[BARE]["ratio_to_session"] == 1.0
    assert all(value > 0 for row in rows.values() for value in row.values())


def test_ratio_and_share_of_a_core_are_those_of_processor_times() -> None:
    on_clock_s, used_s = np.full(4, 0.2), np.array([0.02, 0.02, 0.02, 0.04])
    row = _beside_session(np.column_stack([on_clock_s, used_s]), 0.016)
    assert (row["median_ms"], row["processor_ms"]) == (200.0, 20.0)
    assert row["ratio_to_session"] == 1.25
    assert row["core_share_at_15_hz"] == pytest.approx(15 * 0.025)


def test_without_its_network_the_row_of_segments_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    row = bench_segments()[SEGMENTS]
    assert (
        list(row) == ["not_measured"] and "`trepid networks fetch twinlitenet` gets it" in row["not_measured"]
    )


def test_a_damaged_description_is_an_error_and_no_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network_of_car(tmp_path)
    (tmp_path / "networks" / "mine.yaml").write_text("description: mine\n")
    monkeypatch.setenv("TREPID_CAR", str(tmp_path))
    with pytest.raises(InputError, match=r"mine\.yaml:"):
        bench_segments()
