"""The lesser and the greater of two floats, for the inner loops of every step.

The builtins ``min`` and ``max`` take any number of anything and four times as long.
"""


def at_least(value: float, low: float) -> float:
    """``value``, but no less than ``low``; NaN becomes ``low``."""
    return value if value > low else low


def at_most(value: float, high: float) -> float:
    """``value``, but no more than ``high``; NaN becomes ``high``."""
    return value if value < high else high


def within(value: float, limit: float) -> float:
    """``value`` within ± ``limit``; NaN becomes ``limit``."""
    value = value if value < limit else limit
    return value if value > -limit else -limit
