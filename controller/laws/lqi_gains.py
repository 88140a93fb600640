"""Schedules of LQI gains, computed once per vehicle and kept in a folder of the user.

:mod:`controller.laws.lqi_design` computes a schedule with python-control, whose import alone takes seconds. The
result is kept (:mod:`trepid.files.cache`) under a hash of all inputs of the computation: dead time, lags, settings,
the source of the design and the versions of the libraries.
"""

import json
import math
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from controller.laws.lqi_settings import SPEEDS_MPS, Design, Gains, Lags, LqiSettings, Margins
from trepid.files.cache import cache_file, keep

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
        keep(path, json.dumps(found).encode())
    return found


def _file(lags: tuple[Lags, ...], settings: LqiSettings) -> Path | None:
    """Where the schedule is kept; None without a home folder."""
    sources = [(Path(__file__).parent / name).read_bytes().hex() for name in _SOURCES]
    versions = [version(name) for name in ("control", "numpy", "scipy")]
    key = json.dumps([SPEEDS_MPS, lags, settings.model_dump(mode="json"), sources, versions])
    return cache_file("gains", key, ".json")


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
