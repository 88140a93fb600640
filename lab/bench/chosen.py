"""Parts of a benchmark that are chosen by name."""

from collections.abc import Iterable

from trepid.config import InputError
from trepid.spelling import did_you_mean


def known_names(names: Iterable[str], among: Iterable[str], what: str) -> tuple[str, ...]:
    """``names``. Raises InputError for an unknown one."""
    every = tuple(among)
    for name in names:
        if name not in every:
            hint = did_you_mean(name, every, f"there are {', '.join(every)}")
            raise InputError(f"no {what} {name!r}; {hint}")
    return tuple(names)
