"""Suggestions for misspelt names, for error texts."""

import difflib
from collections.abc import Iterable, Set


def did_you_mean(
    name: str, known: Iterable[str], otherwise: str | None = None, *, most: int = 1, cutoff: float = 0.6
) -> str:
    """``did you mean 'x'?`` with at most ``most`` names of ``known`` that are like ``name``.

    Where none is, ``otherwise``; by default all of ``known``, a set in alphabetical order. ``cutoff``: see difflib.
    """
    known = sorted(known) if isinstance(known, Set) else list(known)
    close = difflib.get_close_matches(name, known, n=most, cutoff=cutoff)
    if close:
        return f"did you mean {' or '.join(map(repr, close))}?"
    return f"known here: {', '.join(known)}" if otherwise is None else otherwise


def did_you_mean_or_list(name: str, known: Iterable[str], command: str) -> str:
    """Up to three names of ``known`` that are like ``name``, and the ``command`` that prints all."""
    return f"{did_you_mean(name, known, '', most=3)} `{command}` prints all".lstrip()
