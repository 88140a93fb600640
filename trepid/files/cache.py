"""Files that save the time of a computation: below ``$XDG_CACHE_HOME/trepid``, by default ``~/.cache/trepid``.

The name of a file is a hash of all that its content depends on. A missing, damaged or unwritable file costs the
time of the computation. Writers replace a file whole; the oldest files of a folder are deleted beyond a limit.
"""

import hashlib
import os
from pathlib import Path

from trepid.files.whole import write_whole

MAX_FILES = 500  # of one folder
DIGITS = 32  # of the hash in a name


def cache_file(folder: str, key: str, suffix: str) -> Path | None:
    """Where the result of a computation on ``key`` is kept; None without a home folder."""
    root = os.environ.get("XDG_CACHE_HOME", "")
    try:
        top = Path(root) if Path(root).is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        return None
    return top / "trepid" / folder / f"{hashlib.sha256(key.encode()).hexdigest()[:DIGITS]}{suffix}"


def cached_content(path: Path | None) -> bytes:
    """The content of a file; empty where it cannot be read."""
    try:
        return b"" if path is None else path.read_bytes()
    except OSError:
        return b""


def keep(path: Path, content: bytes) -> None:
    """Write ``content``, if the folder can be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
        by_age = sorted(path.parent.glob(f"*{path.suffix}"), key=lambda one: one.stat().st_mtime)
        for old in by_age[:-MAX_FILES]:
            old.unlink(missing_ok=True)
    except OSError:
        return
