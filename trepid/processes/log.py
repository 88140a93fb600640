"""The log of a process: the end of what it writes to its standard output and error.

It lies in memory, where no full disk can stop the process that writes or the launcher that starts it again.
"""

import fcntl
import os
import tempfile
from typing import IO

KEPT_BYTES = 65_536
LONGEST_BYTES = 4 * KEPT_BYTES


def new_log() -> IO[bytes]:
    """A file for the log of one process, open for appending. Raises OSError."""
    if not hasattr(os, "memfd_create"):
        return tempfile.TemporaryFile("a+b", buffering=0)
    descriptor = os.memfd_create("trepid")
    # The flag belongs to the open file and holds in the process too, which writes on at the end of a shortened log.
    fcntl.fcntl(descriptor, fcntl.F_SETFL, os.O_RDWR | os.O_APPEND)
    return os.fdopen(descriptor, "r+b", buffering=0)


def shorten(log: IO[bytes]) -> None:
    """Keep the last KEPT_BYTES of a log that is longer than LONGEST_BYTES."""
    if os.fstat(log.fileno()).st_size <= LONGEST_BYTES:
        return
    log.seek(-KEPT_BYTES, os.SEEK_END)
    end = log.read(KEPT_BYTES)
    log.truncate(0)
    log.write(end)
