"""Fits clothoids along any smooth curve, such as the centre of a lane parallel to a spiral.

Between two poses with given curvatures three clothoids make a curve of continuous curvature:
Bertolazzi and Frego, Interpolating clothoid splines with curvature continuity, Math. Meth. Appl. Sci. 41 (2018)
1723-1737; solved by pyclothoids. A span is halved until the fit stays within tolerance of the curve. At a jump of
curvature, as between a line and an arc, a short ramp on either side leads to the mean of both curvatures.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from pydantic import ValidationError

from sim_harness.world.roads.road import TIGHTEST_1PM, Segment
from trepid.config import InputError

TOLERANCE_M = 1e-4  # a tenth of the error allowed between export and import
MIN_SPAN_M = 0.02
MAX_RAMP_M = 1.0
RAMP_BULGE = (
    0.25  # angle times length that a ramp which begins at an angle may be off; a cubic is 4/27 of it off
)
CHECKS = 9  # places within a span where the fit is compared with the curve
SAME_CURVATURE_1PM = 1e-10
SAME_PLACE_M, SAME_HEADING_RAD = 1e-7, 1e-9


@dataclass(frozen=True, slots=True)
class Knot:
    """A pose [m, rad] and the curvature [1/m] there."""

    x_m: float
    y_m: float
    heading_rad: float
    curvature_1pm: float


@dataclass(frozen=True, slots=True)
class FittedCurve:
    """A smooth curve from ``start`` to ``end``; ``exact_m``: its length [m] if it is one clothoid."""

    start: float
    end: float
    at: Callable[[float], Knot]
    exact_m: float | None = None


class NoFit(ValueError):
    """No clothoids follow a span within tolerance."""

    def __init__(self, span: FittedCurve) -> None:
        super().__init__(f"no clothoids follow this curve within {1e3 * TOLERANCE_M:g} mm")
        self.span = span


def fit(spans: Sequence[FittedCurve], *, closed: bool) -> list[list[Segment]]:
    """Segments of continuous curvature along each span, within TOLERANCE_M. Raises NoFit."""
    ends = [span.at(span.end) for span in spans]
    starts = [span.at(span.start) for span in spans]
    joints = [_mean(end, start) for end, start in zip(ends, starts[1:], strict=False)]
    bend = {"curvature_1pm": _mean(ends[-1], starts[0]).curvature_1pm} if closed else {}
    knots = [replace(starts[0], **bend), *joints, replace(ends[-1], **bend)]
    fitted = []
    for span, first_knot, last_knot in zip(spans, knots, knots[1:], strict=False):
        try:
            fitted.append(_span(span, first_knot, last_knot))
        except ValidationError as error:  # too long for a segment
            raise NoFit(span) from error
        if any(segment.tightest_1pm > TIGHTEST_1PM for segment in fitted[-1]):
            raise NoFit(span)
    return _continuous(fitted, closed=closed)


def _mean(a: Knot, b: Knot) -> Knot:
    turn = math.remainder(b.heading_rad - a.heading_rad, math.tau)
    return Knot(
        (a.x_m + b.x_m) / 2,
        (a.y_m + b.y_m) / 2,
        a.heading_rad + turn / 2,
        (a.curvature_1pm + b.curvature_1pm) / 2,
    )


def _span(span: FittedCurve, first: Knot, last: Knot) -> list[Segment]:
    """Segments from ``first`` to ``last``: ramps where these differ from the curve, the fit between."""
    start, end = span.start, span.end
    head: list[Segment] = []
    tail: list[Segment] = []
    if not _same(first, span.at(start)):
        start, head = _ramp(span, first, forward=True)
    if not _same(last, span.at(end)):
        end, tail = _ramp(span, last, forward=False)
    return head + _between(span, start, end) + tail


def _same(a: Knot, b: Knot) -> bool:
    return (
        math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < SAME_PLACE_M
        and abs(math.remainder(a.heading_rad - b.heading_rad, math.tau)) < SAME_HEADING_RAD
        and abs(a.curvature_1pm - b.curvature_1pm) < SAME_CURVATURE_1PM
    )


def _ramp(span: FittedCurve, knot: Knot, *, forward: bool) -> tuple[float, list[Segment]]:
    """The place on the curve where a ramp from (or to) ``knot`` meets it, and the ramp.

    Where ``knot`` is off the curve, as in the middle of a gap of the file, the ramp may be so far off it, too.
    """
    edge = span.at(span.start if forward else span.end)
    off_m = math.hypot(knot.x_m - edge.x_m, knot.y_m - edge.y_m)
    turn_rad = abs(math.remainder(knot.heading_rad - edge.heading_rad, math.tau))
    run = min(MAX_RAMP_M, (span.end - span.start) / 3)
    while run >= MIN_SPAN_M / 4:
        place = span.start + run if forward else span.end - run
        here, there = (span.start, place) if forward else (place, span.end)
        ends = (knot, span.at(place)) if forward else (span.at(place), knot)
        allowed_m = TOLERANCE_M + off_m + RAMP_BULGE * turn_rad * run
        if segments := _three(span, here, there, *ends, tolerance_m=allowed_m):
            return place, segments
        run /= 2
    raise NoFit(span)


def _between(span: FittedCurve, start: float, end: float) -> list[Segment]:
    """Segments along the curve: itself if it is one clothoid, else the fit, halved until it is close."""
    a, b = span.at(start), span.at(end)
    if span.exact_m is not None:
        length_m = span.exact_m * (end - start) / (span.end - span.start)
        return [clothoid(length_m, a.curvature_1pm, b.curvature_1pm)]
    if segments := _three(span, start, end, a, b):
        return segments
    if end - start < MIN_SPAN_M:
        raise NoFit(span)
    middle = (start + end) / 2
    return _between(span, start, middle) + _between(span, middle, end)


def _three(
    span: FittedCurve, start: float, end: float, a: Knot, b: Knot, *, tolerance_m: float = TOLERANCE_M
) -> list[Segment] | None:
    """Three clothoids from ``a`` to ``b``; None if they are a detour or leave the curve between start and end."""
    try:
        import pyclothoids
    except ImportError as error:
        raise InputError(
            "pyclothoids is not installed; lanes off the reference line need it: pip install 'trepid[roads]'"
        ) from error
    turned = a.heading_rad + math.remainder(b.heading_rad - a.heading_rad, math.tau)
    first = (a.x_m, a.y_m, a.heading_rad, a.curvature_1pm)
    pieces = pyclothoids.SolveG2(*first, b.x_m, b.y_m, turned, b.curvature_1pm)
    if not all(math.isfinite(piece.length) and piece.length > 0 for piece in pieces):
        return None
    if sum(piece.length for piece in pieces) > 1.5 * math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) + MIN_SPAN_M:
        return None
    segments = [clothoid(piece.length, piece.KappaStart, piece.KappaEnd) for piece in pieces]
    for i in range(1, CHECKS + 1):
        check = span.at(start + (end - start) * i / (CHECKS + 1))
        if min(piece.Distance(check.x_m, check.y_m) for piece in pieces) >= tolerance_m:
            return None
    return segments


def clothoid(length_m: float, start_1pm: float, end_1pm: float) -> Segment:
    """A segment with curvature rising or falling linearly from its start to its end."""
    if start_1pm == end_1pm:
        return Segment(length_m=length_m, curvature_1pm=start_1pm + 0.0)
    return Segment(length_m=length_m, curvature_1pm=(start_1pm + 0.0, end_1pm + 0.0))  # never -0.0


def _continuous(fitted: list[list[Segment]], *, closed: bool) -> list[list[Segment]]:
    """The segments, each starting with exactly the end curvature of the one before it."""
    before = fitted[-1][-1].end_curvature_1pm if closed else fitted[0][0].start_curvature_1pm
    out: list[list[Segment]] = []
    for segments in fitted:
        out.append([])
        for segment in segments:
            out[-1].append(clothoid(segment.length_m, before, segment.end_curvature_1pm))
            before = segment.end_curvature_1pm
    return out
