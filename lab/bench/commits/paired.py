"""The renderer or the closed loop of this tree beside those of another commit, by computing time, in turns.

The files of the commit lie in a temporary folder meanwhile. Both trees run in processes of their own with the
libraries of this environment, one at a time, so that both meet the same load of the machine.
"""

import io
import os
import signal
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import numpy as np

from trepid.config import ROOT, InputError
from trepid.loudness import note

ROADS = ("circuit", "rolling_hills")  # flat, and with heights, which older commits do not have
TURNS = {"frame": 40, "drive": 6}
WORKER = Path(__file__).with_name("worker.py")


def against_commit(part: str, commit: str) -> dict[str, Any]:
    """Computing times of ``part`` (a frame, or a simulated second of a drive) of both trees, for each road.

    Raises InputError for an unknown commit, outside a clone, and where the commit does not run.
    """
    rows = {}
    with files_of(commit) as tree:
        for road in ROADS:
            if not (tree / "config" / "scenarios" / f"{road}.yaml").is_file():
                note(f"{commit} has no scenario {road}")
                continue
            with ExitStack() as workers:
                takers = [workers.enter_context(worker(of, part, road)) for of in (ROOT, tree)]
                rows[f"{part}, {road}"] = compare(*takers, turns=TURNS[part])
    return rows


def compare(here: Callable[[], float], there: Callable[[], float], *, turns: int) -> dict[str, Any]:
    """Medians [ms] of both, and median and quartiles of the ratio of each turn, which they begin alternately."""
    times_s = np.array([(here(), there()) if turn % 2 else (there(), here())[::-1] for turn in range(turns)])
    low, ratio, high = np.percentile(times_s[:, 0] / times_s[:, 1], [25, 50, 75])
    here_ms, there_ms = np.median(times_s, axis=0) * 1e3
    return {
        "here [ms]": round(float(here_ms), 3),
        "there [ms]": round(float(there_ms), 3),
        "ratio": round(float(ratio), 3),
        "quartiles of the ratio": f"{low:.3f} to {high:.3f}",
    }


@contextmanager
def files_of(commit: str) -> Iterator[Path]:
    """A temporary folder with the files of ``commit``, removed also after an interruption or SIGTERM."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with TemporaryDirectory(prefix="trepid-commit-") as folder:
            _git("rev-parse", "--git-dir", trouble="--against needs git and a clone of the repository")
            name = ("--verify", "--quiet", "--end-of-options", f"{commit}^{{commit}}")
            found = _git("rev-parse", *name, trouble=f"--against: git knows no commit {commit!r} here")
            packed = _git("archive", found.decode().strip(), trouble=f"git cannot read all files of {commit}")
            with tarfile.open(fileobj=io.BytesIO(packed)) as files:
                files.extractall(folder, filter="data")
            yield Path(folder)
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def worker(tree: Path, part: str, road: str) -> Iterator[Callable[[], float]]:
    """A process of ``tree``; the function returns the next time of ``part`` on ``road`` [s]."""
    words = [sys.executable, "-P", str(WORKER), part, road]
    pipe, environment = subprocess.PIPE, os.environ | {"PYTHONPATH": str(tree)}
    with (
        TemporaryFile("w+") as said,
        subprocess.Popen(
            words, cwd=tree, env=environment, stdin=pipe, stdout=pipe, stderr=said, text=True
        ) as process,
    ):

        def take() -> float:
            line = ""
            if process.poll() is None:
                print(file=process.stdin, flush=True)
                line = process.stdout.readline() if process.stdout else ""
            if not line:
                said.seek(0)
                why = said.read().strip().rpartition("\n")[-1]
                raise InputError(f"the files in {tree} do not run with these libraries: {why}")
            return float(line)

        yield take


def _git(*words: str, trouble: str) -> bytes:
    try:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        raise InputError(trouble) from None
