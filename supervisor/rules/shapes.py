"""Shapes of fuzzy sets: trapezoids, and the membership functions of scikit-fuzzy compiled into straight lines.

A set rises once from 0 to 1 and falls once to 0. The engine works on straight lines only: a function such as
``gaussmf`` is compiled at load into lines that differ from it by at most a given tolerance, and the coverage,
monotonicity and slope proofs are made on these lines.
"""

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from trepid.types import Column

Knots = tuple[tuple[float, float], ...]
"""Inner corners (s, degree) of an edge between its foot (0, 0) and its shoulder (1, 1), both rising."""
SAMPLES = 20_001  # of the range of an input, where a function is compiled
MAX_KNOTS = 200  # of an edge; with a tolerance of 0.001 an edge has about 15


class FuzzySet(NamedTuple):
    """Feet and shoulders a <= b <= c <= d, as in scikit-fuzzy's ``trapmf``, and the knots of curved edges."""

    a: float
    b: float
    c: float
    d: float
    rise: Knots = ()  # s from a to b
    fall: Knots = ()  # s from d to c

    def membership(self, x: float) -> float:
        """Degree of ``x``, 0..1; without knots it equals ``skfuzzy.trapmf``."""
        if self.b <= x <= self.c:
            return 1.0
        if self.a < x < self.b:
            return curve_degree((x - self.a) / (self.b - self.a), self.rise)
        if self.c < x < self.d:
            return curve_degree((self.d - x) / (self.d - self.c), self.fall)
        return 0.0

    def corners(self) -> list[tuple[float, float]]:
        """Corners (x, degree) from left to right; a vertical edge has only its upper corner."""
        rise = [(self.a + s * (self.b - self.a), y) for s, y in ((0.0, 0.0), *self.rise) if self.a < self.b]
        fall = [(self.d - s * (self.d - self.c), y) for s, y in ((0.0, 0.0), *self.fall) if self.c < self.d]
        return [*rise, *dict.fromkeys([(self.b, 1.0), (self.c, 1.0)]), *reversed(fall)]


def curve_degree(s: float, knots: Knots) -> float:
    """Degree at ``s`` in 0..1 of the edge through (0, 0), ``knots`` and (1, 1); it never falls as ``s`` rises.

    Between two knots the degree is d0 + (s - s0) (d1 - d0) / (s1 - s0), cut at d1: each operation keeps order, and
    the next knot begins at d1, so the computed degree keeps order too.
    """
    if not knots:
        return s
    k = bisect_right(knots, s, key=lambda knot: knot[0])
    s0, d0 = knots[k - 1] if k else (0.0, 0.0)
    s1, d1 = knots[k] if k < len(knots) else (1.0, 1.0)
    return min(d0 + (s - s0) * ((d1 - d0) / (s1 - s0)), d1)


def mirror_knots(knots: Knots) -> Knots:
    """The knots of the complement of an edge, which rises where the edge falls."""
    return tuple((1.0 - s, 1.0 - degree) for s, degree in reversed(knots))


class CompiledSet(NamedTuple):
    """A set, and the greatest difference in degree to the function that it replaces."""

    shape: FuzzySet
    error: float


def evaluate(function: str, parameters: tuple[float, ...], x: Column) -> Column:
    """Degrees of scikit-fuzzy's ``function`` at ``x``, shape (n,). Raises ValueError for bad parameters."""
    import skfuzzy  # takes 0.4 s: only files that use its functions wait for it

    lists = function in ("trimf", "trapmf", "piecemf")
    with np.errstate(all="ignore"):
        try:
            degrees = getattr(skfuzzy, function)(x, *([list(parameters)] if lists else parameters))
        except AssertionError as error:
            raise ValueError(f"{function}: {error}") from error
    if not np.isfinite(degrees).all() or degrees.min() < -1e-9 or degrees.max() > 1 + 1e-9:
        raise ValueError(f"{function}: the degrees are not within 0..1 for the parameters {list(parameters)}")
    return np.asarray(degrees, dtype=np.float64)


def polyline(corners: tuple[tuple[float, float], ...]) -> FuzzySet:
    """The set with the ``corners`` (x, degree). Raises ValueError unless it rises to 1 once and falls to 0 once."""
    top = [x for x, y in corners if y == 1]
    before = [corner for corner in corners if top and corner[0] < top[0]]
    after = [corner for corner in reversed(corners) if top and corner[0] > top[-1]]
    places = [x for x, _ in corners]
    if places != sorted(places):
        raise ValueError(f"the points must not fall, got {places}")
    if not 0 < len(top) <= 2 or [*before, *((x, 1.0) for x in top), *reversed(after)] != list(corners):
        raise ValueError(SHAPE)
    a, rise = _knots(before, top[0])
    d, fall = _knots(after, top[-1])
    return FuzzySet(a, top[0], top[-1], d, rise, fall)


SHAPE = "expected points that rise from 0 to 1 once and fall to 0 once, or shoulders at 1"


def _knots(corners: list[tuple[float, float]], shoulder: float) -> tuple[float, Knots]:
    """Foot and knots of the edge from its foot at ``corners[0]`` up to 1 at ``shoulder``; a shoulder has none."""
    if not corners:
        return shoulder, ()
    (foot, lowest), *inner = corners
    degrees = [y for _, y in inner]
    if lowest != 0 or any(not 0 < y < 1 for y in degrees) or degrees != sorted(degrees):
        raise ValueError(SHAPE)
    return foot, tuple(((x - foot) / (shoulder - foot), y) for x, y in inner)


def compile_set(
    function: str, parameters: tuple[float, ...], span: tuple[float, float], tolerance: float
) -> CompiledSet:
    """scikit-fuzzy's ``function`` over the range ``span`` as straight lines within ``tolerance`` in degree.

    Raises ValueError where the function does not rise once to 1 and fall once, or an edge is too steep.
    """
    x = np.linspace(*span, SAMPLES)
    y = evaluate(function, parameters, x)
    full = np.flatnonzero(y >= 1 - tolerance / 2)
    if not len(full):
        raise ValueError(f"{function}: the greatest degree in the range is {y.max():.4g}; it must reach 1")
    first, last = int(full[0]), int(full[-1])
    if (
        (np.diff(y[: first + 1]) < -1e-9).any()
        or (np.diff(y[last:]) > 1e-9).any()
        or len(full) <= last - first
    ):
        raise ValueError(f"{function}: the degrees must rise to 1 once and fall once")
    a, rise = _edge(x[: first + 1], y[: first + 1], tolerance)
    d, fall = _edge(x[last:][::-1], y[last:][::-1], tolerance)
    shape = FuzzySet(a, float(x[first]), float(x[last]), d, rise, fall)
    fine = np.linspace(*span, 2 * SAMPLES - 1)
    at, degrees = zip(*shape.corners(), strict=True)
    lines = np.interp(fine, at, degrees, left=degrees[0] if a >= span[0] else 0.0)
    error = float(np.abs(lines - evaluate(function, parameters, fine)).max())
    if error > tolerance:
        raise ValueError(
            f"{function}: an edge is too steep to be compiled within {tolerance:g} (error {error:.2g})"
        )
    return CompiledSet(shape, error)


def _edge(x: Column, y: Column, tolerance: float) -> tuple[float, Knots]:
    """Foot and knots of the edge that rises along ``x`` (which may fall) from nearly 0 to nearly 1."""
    if len(x) == 1:  # a shoulder at the end of the range
        return float(x[0]), ()
    low = np.flatnonzero(y <= tolerance / 2)
    if len(low):
        x, y = x[low[-1] :], y[low[-1] :].copy()
        y[0] = 0.0
    else:  # the foot lies outside the range, where no value counts: one line leads to it
        x, y = np.concatenate([[2 * x[0] - x[-1]], x]), np.concatenate([[0.0], y])
    y[-1] = 1.0
    s = (x - x[0]) / (x[-1] - x[0])
    kept = _simplify(s, y, tolerance / 2)
    return float(x[0]), tuple((float(s[i]), float(y[i])) for i in kept[1:-1])


def _simplify(s: Column, y: Column, tolerance: float) -> list[int]:
    """Indices of the corners of a polyline within ``tolerance`` of (s, y) (Ramer, Douglas and Peucker, 1973)."""
    kept = [0, len(s) - 1]
    spans = [(0, len(s) - 1)]
    while spans:
        i, j = spans.pop()
        line = y[i] + (s[i : j + 1] - s[i]) * ((y[j] - y[i]) / (s[j] - s[i]))
        worst = i + int(np.abs(line - y[i : j + 1]).argmax())
        if abs(line[worst - i] - y[worst]) > tolerance and len(kept) < MAX_KNOTS:
            kept.append(worst)
            spans += [(i, worst), (worst, j)]
    return sorted(kept)
