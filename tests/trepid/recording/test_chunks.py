"""The packed index of the chunks of a recording."""

import tracemalloc
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from trepid.recording.writer import KEPT, PackedIndices, pack_indices

CHANNELS, CHUNKS = 16, 300


def write_chunks(path: Path, *, packed: bool) -> int:
    """Write CHUNKS chunks with messages of CHANNELS channels; what the writer holds before its end [bytes]."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        if packed:
            pack_indices(writer)
        writer.start(library="test")
        channels = [writer.register_channel(f"/{number}", "cdr", 0) for number in range(CHANNELS)]
        tracemalloc.start()
        for chunk in range(CHUNKS):
            for channel in channels:
                writer.add_message(channel_id=channel, log_time=chunk, publish_time=chunk, data=b"x")
            writer.flush()
        held, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert isinstance(getattr(writer, KEPT), PackedIndices) is packed
        writer.finish()
    return held


def test_a_packed_index_leaves_the_file_the_same_and_takes_a_quarter_of_the_memory(tmp_path: Path) -> None:
    plain, packed = tmp_path / "plain.mcap", tmp_path / "packed.mcap"
    plain_bytes, packed_bytes = write_chunks(plain, packed=False), write_chunks(packed, packed=True)
    assert packed_bytes < plain_bytes / 4
    assert packed.read_bytes() == plain.read_bytes()
    with packed.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == CHUNKS
    assert all(len(index.message_index_offsets) == CHANNELS for index in summary.chunk_indexes)
