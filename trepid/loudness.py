"""What is said beside a result, on standard error.

A *note* is progress, or an assumption; ``--quiet`` leaves notes out. A *detail*, such as a file that is read, is
only said with ``--verbose``. A *warning* is said at every loudness. A standard error that refuses the text, such as
a file on a full disk, or is closed, ends nothing.
"""

import sys
from contextlib import suppress
from enum import IntEnum


class Loudness(IntEnum):
    """How much is said."""

    QUIET = 0
    USUAL = 1
    VERBOSE = 2


_loudness = Loudness.USUAL


def loudness() -> Loudness:
    """The loudness of this process."""
    return _loudness


def speak(wanted: Loudness) -> None:
    """Set the loudness of this process."""
    global _loudness  # noqa: PLW0603 - as standard error, it belongs to the process
    _loudness = wanted


def note(*words: object) -> None:
    """Say ``words`` in a line, unless quiet."""
    if _loudness >= Loudness.USUAL:
        warn(*words)


def detail(*words: object) -> None:
    """Say ``words`` in a line, where details are wanted."""
    if _loudness >= Loudness.VERBOSE:
        warn(*words)


def warn(*words: object) -> None:
    """Say ``words`` in a line at every loudness."""
    if sys.stderr is None:  # closed; print would take standard output
        return
    with suppress(OSError):
        print(*words, file=sys.stderr, flush=True)
