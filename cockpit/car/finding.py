"""One finding of ``trepid doctor``."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check, and the remedy of a fault."""

    check: str
    ok: bool
    message: str
    remedy: str = ""  # of a failed check, or advice
