"""Command-line options of ``trepid bench perception``."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class PerceptionOptions:
    """Options of the benchmark of the estimators."""

    seed: int
    estimators: tuple[str, ...] = ()  # empty: all
    quick: bool = False
    repeats: int = 1
    jobs: int = 1
    keep_frames: bool = False
    out: Path | None = None  # folder for tables and figures
    data: Path | None = None  # folder of the real sets
    parts: tuple[str, ...] = ("set", "real")
