"""The explanation of the fear that rules infer from values."""

from collections.abc import Mapping
from typing import Any

from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from trepid.config import InputError
from trepid.spelling import did_you_mean


def explanation(rules: FearRules, given: Mapping[str, float | None]) -> dict[str, Any]:
    """Fear, level, cause, rules and effects of the values ``given``, as ``trepid fear explain --json`` prints them.

    None is a missing value; inputs that are not given stand at the calm end of their range (``assumed_calm``).
    Raises InputError for a name that the rules do not define.
    """
    for name in given:
        check_name(name, rules, name)
    values = {**calmest(rules), **given}
    result = rules.evaluate(values)
    return {
        "fear": result.fear,
        "level": result.level,
        "memberships": rules.memberships(values),
        "rules": [
            {"text": text, "strength": strength}
            for text, strength in zip(result.texts, result.strengths, strict=True)
        ],
        "cause": result.cause,
        "speed_factor": rules.speed_factor(result.fear),  # without hysteresis, like the mode
        "mode": rules.mode(result.fear),
        "trust": {name: trust.trust for name, trust in rules.trust(values).items()},
        "assumed_calm": [name for name in rules.names if name not in given],
    }


def check_name(name: str, rules: FearRules, place: str) -> None:
    """Raise InputError, at ``place``, unless the rules have an input ``name``."""
    if name not in rules.inputs:
        raise InputError(f"{place}: unknown input {name!r}; {did_you_mean(name, rules.names)}")
