"""Rows of numbers that a long run puts away in blocks: in memory, or in an unnamed temporary file.

A disk that is full or refuses to be written changes nothing but the place: later blocks then stay in memory.
"""

import os
import tempfile
from contextlib import suppress
from typing import IO

import numpy as np

from trepid.types import Column


class Blocks:
    """Blocks of rows of one width, in order."""

    def __init__(self, width: int, *, on_disk: bool) -> None:
        self._width = width
        self._kept: list[Column] = []  # after those in the file
        self._file: IO[bytes] | None = None
        self._size = 0  # of the blocks in the file [bytes]
        if on_disk:
            with suppress(OSError):
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as this object

    def add(self, block: Column) -> None:
        """Append the rows of ``block``."""
        if self._kept or not self._is_written(block.tobytes()):
            self._kept.append(block)

    def table(self) -> Column:
        """All rows."""
        stored = b"" if self._file is None else os.pread(self._file.fileno(), self._size, 0)
        return np.concatenate([np.frombuffer(stored).reshape(-1, self._width), *self._kept], dtype=np.float64)

    def _is_written(self, data: bytes) -> bool:
        if self._file is None:
            return False
        with suppress(OSError):
            if os.pwrite(self._file.fileno(), data, self._size) == len(data):
                self._size += len(data)
                return True
        return False
