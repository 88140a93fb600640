"""The way of a newcomer: a clone of this checkout, ``make drive`` in it, and the disk space that both take.

The environment is set up anew and without pip's cache, so that every package is downloaded.
"""

import os
import re
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from trepid.config import ROOT, InputError

DRIVES = re.compile(r"speed +[1-9][0-9.]* m/s")  # of a status line: at least 1 m/s
READY = "is ready to drive"
LONG_ENOUGH = ("--duration", "15", "--no-dashboard")  # a drive in which the car does not start fails
LONGEST_S = 1800.0


def bench_newcomer() -> dict[str, Any]:
    """Times from the beginning of the clone, times from a command to its first line [s], and disk space [MB].

    Raises InputError where the checkout, git or make is missing, and when the drive fails.
    """
    if not (ROOT / "Makefile").is_file():
        raise InputError("bench newcomer clones the checkout; this is an installed package")
    with TemporaryDirectory(prefix="trepid-newcomer-") as place:
        clone = Path(place) / "trepid"
        began_s = time.monotonic()
        _run("git", "clone", "--quiet", str(ROOT), str(clone), cwd=Path(place))
        cloned_s = time.monotonic() - began_s
        ready_s, driving_s = _drive(clone, began_s)
        help_s = _first_line_s(clone, "--help")
        drive_s = _first_line_s(clone, "drive", *LONG_ENOUGH)
        environment_mb, all_mb = _disk_mb(clone / ".venv"), _disk_mb(clone)
    return {
        "time [s]": {"cloned": cloned_s, "environment ready": ready_s, "driving": driving_s},
        "first line [s]": {"trepid --help": help_s, "trepid drive": drive_s},
        "disk [MB]": {"environment": environment_mb, "clone and environment": all_mb},
    }


def _drive(clone: Path, began_s: float) -> tuple[float, float]:
    """Times at which the environment is ready and at which the car drives [s]."""
    words = ["make", "drive", f"ARGS={' '.join(LONG_ENOUGH)}"]
    ready_s = driving_s = None
    said = []
    with subprocess.Popen(
        words,
        cwd=clone,
        env={**_environment(), "PIP_NO_CACHE_DIR": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as made:
        assert made.stdout is not None
        for line in made.stdout:
            said.append(line.strip())
            elapsed_s = time.monotonic() - began_s
            if ready_s is None and READY in line:
                ready_s = elapsed_s
            elif driving_s is None and DRIVES.search(line):
                driving_s = elapsed_s
    if made.returncode or ready_s is None or driving_s is None:
        raise InputError(f"make drive failed in a fresh clone: {' | '.join(said[-5:])}")
    return ready_s, driving_s


def _first_line_s(clone: Path, *words: str) -> float:
    """Time from the start of ``trepid`` with ``words`` to its first line [s]; waits for its end."""
    began_s = time.monotonic()
    with subprocess.Popen(
        [clone / ".venv" / "bin" / "trepid", *words],
        cwd=clone,
        env=_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as program:
        assert program.stdout is not None
        line = program.stdout.readline()
        first_s = time.monotonic() - began_s
        program.stdout.read()
    if program.returncode or not line:
        raise InputError(f"trepid {words[0]} failed in a fresh clone: {line.strip()}")
    return first_s


def _environment() -> dict[str, str]:
    """The environment of a newcomer: without settings of this checkout."""
    return {
        name: value for name, value in os.environ.items() if not name.startswith(("TREPID", "PYTHONPATH"))
    }


def _run(*words: str, cwd: Path) -> None:
    try:
        subprocess.run(words, cwd=cwd, check=True, capture_output=True, text=True, timeout=LONGEST_S)
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(f"{' '.join(words[:2])} failed: {error}") from error


def _disk_mb(folder: Path) -> float:
    """Disk space of all files below ``folder`` [MB]; a file with several names counts once."""
    found = {}
    for path in folder.rglob("*"):
        status = path.lstat()
        found[status.st_ino] = 512 * status.st_blocks
    return sum(found.values()) / 1e6
