"""One finding of ``trepid doctor``."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check: what was found, and what to do about it."""

    check: str
    ok: bool
    message: str
    remedy: str = ""  # of a failed check, or advice
