"""Closed intervals that are never empty."""

Interval = tuple[float, float]


def clip(value: float, interval: Interval) -> float:
    """The point of ``interval`` nearest to ``value``."""
    low, high = interval
    return max(low, min(high, value))


def narrow(outer: Interval, inner: Interval) -> Interval:
    """The part of ``outer`` in ``inner``, or the point of ``outer`` nearest to it: never empty."""
    return clip(inner[0], outer), clip(inner[1], outer)


def inside(value: float, interval: Interval) -> bool:
    """Whether ``value`` lies in ``interval``, its ends included."""
    low, high = interval
    return low <= value <= high
