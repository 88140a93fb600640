"""The DBC files of opendbc: which load, and whether every message means what cantools reads in the whole file."""

import importlib.util
from collections import Counter
from pathlib import Path
from typing import Any

import cantools

from trepid.config import InputError
from vehicle.actuators.can.dbc import Dbc

COLUMNS = (
    *("files", "by_cantools", "by_cantools_unchecked", "without_messages", "usable", "whole"),
    *("messages", "loaded", "differ"),
)
Layout = tuple[int, int, str, bool, float, float, bool]


def bench_dbc() -> dict[str, Any]:
    """Files and messages of opendbc that load, and those that differ. Raises InputError without opendbc.

    A file is usable with one message that loads, because a map of signals needs some messages only, and whole
    when all signals of all messages load. Files without messages hold comments and values for others. A message
    differs when a signal of it has other bits, another sign or another factor than cantools reads in the whole
    file, which it reads without its checks (``strict=False``).
    """
    found = importlib.util.find_spec("opendbc")
    if found is None or found.origin is None:
        raise InputError("bench dbc reads the files of opendbc: pip install 'trepid[test]'")
    counts: Counter[str] = Counter()
    for path in sorted(Path(found.origin).parent.rglob("*.dbc")):
        counts += count_file(path)
    return {"opendbc": {name: counts[name] for name in COLUMNS}}


def count_file(path: Path) -> Counter[str]:
    """What :func:`bench_dbc` counts, of one file."""
    theirs = _of_cantools(path, strict=False)
    counts = Counter(
        files=1,
        by_cantools=int(_of_cantools(path, strict=True) is not None),
        by_cantools_unchecked=int(theirs is not None),
    )
    file = Dbc(path)
    for name in file.messages:
        counts["messages"] += 1
        own = _layout_of(file, name)
        if own is None:
            continue
        counts["loaded"] += 1
        if theirs is not None and name in theirs and theirs[name] != own:
            counts["differ"] += 1
    counts["without_messages"] = int(not file.messages)
    counts["usable"] = int(counts["loaded"] > 0)
    counts["whole"] = int(counts["loaded"] == counts["messages"] > 0)
    return counts


def _layout_of(file: Dbc, name: str) -> dict[str, Layout] | None:
    """The signals of a message, each read in the frames that hold it; None where one is refused."""
    signals: dict[str, Layout] = {}
    try:
        for group in _groups(file, name):
            signals |= {signal.name: _layout(signal) for signal in file.message(name, group).signals}
    except InputError:
        return None
    return signals


def _groups(file: Dbc, name: str) -> list[set[str]]:
    """All signals of a message at once, or one at a time where no frame holds all of them."""
    names = set(file.signals(name))
    try:
        alone = file.selector(name, names) is None
    except InputError:
        alone = False
    return [names] if alone else [{each} for each in sorted(names)]


def _of_cantools(path: Path, *, strict: bool) -> dict[str, dict[str, Layout]] | None:
    """The signals by message; None for a file that cantools refuses."""
    try:
        database: Any = cantools.database.load_file(path, strict=strict)
    except (cantools.Error, ValueError, KeyError):
        return None
    return {
        message.name: {signal.name: _layout(signal) for signal in message.signals}
        for message in database.messages
    }


def _layout(signal: Any) -> Layout:
    return (
        signal.start,
        signal.length,
        signal.byte_order,
        signal.is_signed,
        float(signal.scale),
        float(signal.offset),
        signal.is_float,
    )
