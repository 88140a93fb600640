"""Files that their publishers offer, fetched once into the data folder of the user."""

import os
import urllib.error
import urllib.request
from pathlib import Path

from trepid.config import InputError
from trepid.files.whole import write_whole

TIMEOUT_S = 60.0


def data_file(folder: str, name: str) -> Path:
    """Where the file ``name`` is kept: below ``$XDG_DATA_HOME``, by default ``~/.local/share``."""
    root = Path(os.environ.get("XDG_DATA_HOME", ""))
    top = root if root.is_absolute() else Path.home() / ".local" / "share"
    return top / "trepid" / folder / name


def download(address: str) -> bytes:
    """The bytes at ``address``. Raises InputError where they cannot be read."""
    try:
        with urllib.request.urlopen(address, timeout=TIMEOUT_S) as answer:
            content: bytes = answer.read()
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise InputError(f"{address}: cannot be read: {getattr(error, 'reason', error)}") from error
    return content


def store(path: Path, content: bytes) -> None:
    """Write ``content`` whole or not at all. Raises InputError, and then leaves nothing behind."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
