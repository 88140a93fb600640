"""Two saved traces side by side: equal bit for bit, or the first sample that differs, and the figures of both."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import LABELS, Trace
from trepid.config import InputError


def compare_traces(one: Path, other: Path) -> tuple[dict[str, Any], tuple[Trace, Trace]]:
    """The comparison of two files of ``trepid sim run --trace``, for JSON, and both traces. Raises InputError.

    ``first_difference``: time from the start of the run, and by column both values at the first sample that
    differs; None where all common samples of all common columns are equal.
    """
    a, b = Trace.load(one), Trace.load(other)
    scores = [_scores(one, a), _scores(other, b)]
    return {
        "kind": "traces",
        "trace_sha256": [a.sha256, b.sha256],
        "equal": a.sha256 == b.sha256,
        "samples": [len(a), len(b)],
        "only_a": sorted(a.columns.keys() - b.columns.keys()),
        "only_b": sorted(b.columns.keys() - a.columns.keys()),
        "first_difference": first_difference(a, b),
        "scores": scores,
    }, (a, b)


def first_difference(one: Trace, other: Trace) -> dict[str, Any] | None:
    """The first sample that differs; see :func:`compare_traces`."""
    common = [name for name in one.columns if name in other.columns]
    count = min(len(one), len(other))
    differs = np.array([_differs(one, other, name, count) for name in common]).reshape(len(common), count)
    samples = np.flatnonzero(differs.any(axis=0))
    if len(samples) == 0:
        return None
    at = int(samples[0])
    names = [name for name, row in zip(common, differs, strict=True) if row[at]]
    fields = {name: [_value(one, name, at), _value(other, name, at)] for name in names}
    return {"t_s": round(float(one["t_s"][at] - one["t_s"][0]), 3), "fields": fields}


def numbers(trace: Trace) -> dict[str, float | None]:
    """The scores of a run that are numbers, and its seconds by mode and cause."""
    found: dict[str, float | None] = {}
    scores = asdict(measure(trace))
    del scores["stop_cause"]  # a word
    for name, value in scores.items():
        if isinstance(value, dict):
            found |= {f"{name.removesuffix('s')}_{key}_s": float(part) for key, part in value.items()}
        else:
            found[name] = None if value is None else float(value)
    return found


def _scores(path: Path, trace: Trace) -> dict[str, float | None]:
    try:
        return numbers(trace)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _differs(one: Trace, other: Trace, name: str, count: int) -> np.ndarray:
    a, b = one[name][:count], other[name][:count]
    if name in LABELS:
        return np.array([_word(one, name, x) != _word(other, name, y) for x, y in zip(a, b, strict=True)])
    return ~((a == b) | (np.isnan(a) & np.isnan(b)))


def _word(trace: Trace, label: str, code: float) -> str | None:
    return trace.words[label][int(code)] if code >= 0 else None


def _value(trace: Trace, name: str, at: int) -> Any:
    value = float(trace[name][at])
    return _word(trace, name, value) if name in LABELS else None if np.isnan(value) else value
