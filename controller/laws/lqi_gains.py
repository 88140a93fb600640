"""Schedules of LQI gains, computed once per vehicle and kept in a folder of the user.

:mod:`controller.laws.lqi_design` computes a schedule with python-control, whose import alone takes seconds. The
result is kept as ``gains/KEY.json`` below ``$XDG_CACHE_HOME/trepid`` (default ``~/.cache/trepid``). KEY is a hash
of all inputs of the computation: dead time, lags, settings, the source of the design and the versions of the
libraries. A missing, damaged or unwritable file costs the time of a computation; writers replace a file whole.
"""

import hashlib
import json
import math
import os
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from controller.laws.lqi_settings import SPEEDS_MPS, Design, Gains, Lags, LqiSettings, Margins

_MAX_FILES = 500  # the oldest are deleted beyond
_SOURCES = ("lqi_design.py", "lqi_settings.py")


@lru_cache(maxsize=64)
def schedule(lags: tuple[Lags, ...], settings: LqiSettings) -> tuple[Design, ...]:
    """A design at each of ``SPEEDS_MPS``; ``lags``: dead time and lags at each."""
    path = _file(lags, settings)
    stored = _read(path)
    if stored is not None:
        return stored
    from controller.laws.lqi_design import design

    found = tuple(design(speed, lag, settings) for speed, lag in zip(SPEEDS_MPS, lags, strict=True))
    if path is not None:
        _write(path, found)
    return found


def _file(lags: tuple[Lags, ...], settings: LqiSettings) -> Path | None:
    """Where the schedule is kept; None without a home folder."""
    folder = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(folder) if Path(folder).is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        return None
    sources = [(Path(__file__).parent / name).read_bytes().hex() for name in _SOURCES]
    versions = [version(name) for name in ("control", "numpy", "scipy")]
    text = json.dumps([SPEEDS_MPS, lags, settings.model_dump(mode="json"), sources, versions])
    return root / "trepid" / "gains" / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.json"


def _read(path: Path | None) -> tuple[Design, ...] | None:
    """The stored schedule; None unless it is complete and finite."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8")) if path is not None else None
        designs = tuple(
            Design(float(speed), float(bandwidth), Gains(*map(float, gains)), Margins(*map(float, margins)))
            for speed, bandwidth, gains, margins in rows or ()
        )
    except (OSError, ValueError, TypeError):
        return None
    finite = all(math.isfinite(one.bandwidth_radps + sum(one.gains)) for one in designs)
    return designs if finite and tuple(one.speed_mps for one in designs) == SPEEDS_MPS else None


def _write(path: Path, designs: tuple[Design, ...]) -> None:
    """Store the schedule, if the folder can be written, and delete the oldest files beyond the limit."""
    fresh = path.with_suffix(f".{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            fresh.write_text(json.dumps(designs), encoding="utf-8")
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
        kept = sorted(path.parent.glob("*.json"), key=lambda one: one.stat().st_mtime)
        for old in kept[:-_MAX_FILES]:
            old.unlink(missing_ok=True)
    except OSError:
        return
