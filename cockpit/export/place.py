"""The place of an export: never an existing file, found unwritable before the work, and whole or absent."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from trepid.config import InputError
from trepid.recording.writer import check_free


@contextmanager
def new_place(out: Path) -> Iterator[Path]:
    """A path beside ``out`` for the work, which becomes ``out`` at the end; after a failure nothing is left.

    Raises InputError when ``out`` exists, or cannot be written.
    """
    check_free(out)
    try:
        with TemporaryDirectory(dir=out.absolute().parent, prefix=".trepid-export-") as folder:
            work = Path(folder) / out.name
            yield work
            check_free(out)  # again: the work takes a while
            work.rename(out)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error
