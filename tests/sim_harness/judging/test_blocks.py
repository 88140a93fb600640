"""Rows are put away in a file or, where the disk refuses them, in memory."""

from pathlib import Path

import numpy as np
import pytest
from disk_rig import files_limited_to
from trace_rig import state, truth

from sim_harness.judging import trace
from sim_harness.judging.trace import Blocks, Recorder


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize("room", [10**6, 100, 64, 0])
def test_all_rows_are_there_in_order_also_when_the_disk_is_full(on_disk: bool, room: int) -> None:
    rows = np.arange(24.0).reshape(12, 2)
    blocks = Blocks(2, on_disk=on_disk)
    with files_limited_to(room):
        for begin in range(0, 12, 4):
            blocks.add(rows[begin : begin + 4])
    blocks.add(rows[:1])
    assert blocks.table().tolist() == [*rows.tolist(), rows[0].tolist()]


def test_a_trace_is_the_same_wherever_its_samples_lie(monkeypatch: pytest.MonkeyPatch) -> None:
    hashes = set()
    for block, on_disk in ((1000, False), (7, False), (7, True)):
        monkeypatch.setattr(trace, "BLOCK", block)
        recorder = Recorder(on_disk=on_disk)
        for n in range(30):
            recorder.add(truth(0.01 * n, station_m=0.1 * n), state(0.01 * n), None, None, {})
        assert len(recorder.trace()) == 30
        hashes.add(recorder.trace().sha256)
    assert len(hashes) == 1


def test_samples_that_are_put_away_take_no_memory() -> None:
    import tracemalloc

    recorder = Recorder(on_disk=True)

    def size_after(samples: int) -> int:
        for n in range(samples):
            recorder.add(truth(0.01 * n), state(0.01 * n), None, None, {})
        rooms = [
            tracemalloc.Filter(True, str(Path(trace.__file__).parent / "*")),
            tracemalloc.Filter(True, __file__),
        ]
        return sum(kept.size for kept in tracemalloc.take_snapshot().filter_traces(rooms).traces)

    tracemalloc.start()
    try:
        before = size_after(4 * trace.BLOCK)  # the buffers of the first blocks stay
        assert size_after(10 * trace.BLOCK) - before < 100_000  # one sample has 300 bytes
    finally:
        tracemalloc.stop()
