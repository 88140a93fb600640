"""Comparison of two sweeps by trace hash: ``python -m sim_harness.sweep.trace_hashes BEFORE.jsonl AFTER.jsonl``.

Each file holds the lines of ``trepid sim run … --json``. The command prints the runs of the first file whose hash
differs in the second file or that are missing there, and exits with 1 if there are any.
"""

import json
import sys
from pathlib import Path

from trepid.config import read_text

Run = tuple[str, int]


def hashes(path: Path) -> dict[Run, str]:
    """Trace hash of every run in ``path`` by scenario and seed."""
    rows = map(json.loads, read_text(path).splitlines())
    return {(row["scenario"], row["seed"]): row["trace_sha256"] for row in rows}


def differing(before: dict[Run, str], after: dict[Run, str]) -> list[Run]:
    """Runs of ``before`` with another hash in ``after``, or missing from it."""
    return [run for run, digest in before.items() if after.get(run) != digest]


def main() -> int:
    """Compare the two files named on the command line."""
    before, after = (hashes(Path(name)) for name in sys.argv[1:3])
    wrong = differing(before, after)
    for scenario, seed in wrong:
        print(f"{scenario} seed {seed}: {'differs' if (scenario, seed) in after else 'missing'}")
    print(f"{len(before) - len(wrong)} of {len(before)} traces are equal")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
