"""The reference line of an OpenDRIVE road: lines, arcs, spirals and cubic polynomials as functions of s.

ASAM OpenDRIVE 1.7.0, chapter 7 (geometry). A shape is a curve from the origin along x. It gives its pose and its
curvature [1/m] at the length ``s`` [m] from its start, and continues smoothly beyond its ends.
"""

import math
from dataclasses import dataclass, replace

from numpy.polynomial import Polynomial

from sim_harness.world.opendrive.located_xml import Element
from sim_harness.world.roads.road import GAUSS, TIGHTEST_1PM

QUADRATURE_STEP_M = 0.5  # three-point Gauss-Legendre: 1e-9 m per kilometre for radii above 5 m
PARAMETER_STEPS = 6
MAX_LENGTH_M = 1e5  # of one geometry
JOINT_M, JOINT_RAD = 0.01, 0.01  # gaps of files written with few digits
SLIVER_M = 0.02  # a shorter piece, from rounding or from an editor, belongs to its neighbours
LENGTH_ROUNDING_M = 1e-3  # of a difference of two stations
SLIVER_TURN_RAD = 0.05  # by slivers between two pieces
SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")

Pose = tuple[float, float, float]  # x, y [m], heading [rad]


@dataclass(frozen=True, slots=True)
class Clothoid:
    """κ(s) = κ₀ + κ' s: line, arc or spiral."""

    curvature_1pm: float
    rate_1pm2: float = 0.0

    def pose(self, s: float) -> Pose:
        """The integral of (cos θ, sin θ)."""
        x = y = 0.0
        count = max(1, math.ceil(abs(s) / QUADRATURE_STEP_M))
        step = s / count
        for i in range(count):
            for node, weight in GAUSS:
                heading = self._heading((i + node) * step)
                x += weight * step * math.cos(heading)
                y += weight * step * math.sin(heading)
        return x, y, self._heading(s)

    def curvature(self, s: float) -> float:
        return self.curvature_1pm + self.rate_1pm2 * s

    def speed(self, s: float) -> float:
        return 1.0

    def _heading(self, s: float) -> float:
        return s * (self.curvature_1pm + 0.5 * self.rate_1pm2 * s)


@dataclass(frozen=True, slots=True)
class Cubic:
    """(u(p), v(p)) with p = ``scale``·s, or, where ``scale`` is None, with p such that s is the arc length."""

    u: Polynomial
    v: Polynomial
    scale: float | None

    def pose(self, s: float) -> Pose:
        """Position, and the direction of (u', v')."""
        p = self._parameter(s)
        return float(self.u(p)), float(self.v(p)), math.atan2(self.v.deriv()(p), self.u.deriv()(p))

    def curvature(self, s: float) -> float:
        """(u' v'' - v' u'') / |(u', v')|³."""
        p = self._parameter(s)
        u1, v1 = float(self.u.deriv()(p)), float(self.v.deriv()(p))
        u2, v2 = float(self.u.deriv(2)(p)), float(self.v.deriv(2)(p))
        return (u1 * v2 - v1 * u2) / math.hypot(u1, v1) ** 3

    def speed(self, s: float) -> float:
        """Way per ``s``: 1 but for a curve whose parameter is not its length, as tools write them."""
        return 1.0 if self.scale is None else self.scale / self._slowness(self._parameter(s))

    def _parameter(self, s: float) -> float:
        """Runge-Kutta of order 4 on dp/ds = 1/|(u', v')|."""
        if self.scale is not None:
            return self.scale * s
        p, h = 0.0, s / (count := max(PARAMETER_STEPS, math.ceil(abs(s))))
        for _ in range(count):
            k1 = self._slowness(p)
            k2 = self._slowness(p + h / 2 * k1)
            k3 = self._slowness(p + h / 2 * k2)
            p += h / 6 * (k1 + 2 * k2 + 2 * k3 + self._slowness(p + h * k3))
        return p

    def _slowness(self, p: float) -> float:
        return 1.0 / math.hypot(float(self.u.deriv()(p)), float(self.v.deriv()(p)))


Shape = Clothoid | Cubic


@dataclass(frozen=True, slots=True)
class Piece:
    """One <geometry> of a road's reference line."""

    element: Element
    start_m: float
    length_m: float
    origin: Pose
    shape: Shape

    def pose(self, s: float) -> Pose:
        """x, y and heading at the road's station ``s``."""
        x0, y0, heading0 = self.origin
        x, y, heading = self.shape.pose(s - self.start_m)
        cos, sin = math.cos(heading0), math.sin(heading0)
        return x0 + x * cos - y * sin, y0 + x * sin + y * cos, heading0 + heading

    def curvature(self, s: float) -> float:
        """Curvature [1/m] at the road's station ``s``."""
        return self.shape.curvature(s - self.start_m)

    def speed(self, s: float) -> float:
        """Way of the reference line per station at ``s``."""
        return self.shape.speed(s - self.start_m)


def plan_view(road: Element) -> list[Piece]:
    """The pieces of the reference line of ``road``, in order; slivers are left to their neighbours.

    Raises InputError.
    """
    elements = road.need("planView").all("geometry")
    if not elements:
        raise road.need("planView").error("expected at least one <geometry>")
    lengths_m = [_length_m(element) for element in elements]
    if not max(lengths_m) > 0.0:
        raise elements[0].error("length=0: expected more than 0 m")
    long = [length_m >= min(SLIVER_M, max(lengths_m)) for length_m in lengths_m]
    pieces: list[Piece] = []
    bridged_m = 0.0  # by the slivers since the last piece
    for element, length_m, is_long in zip(elements, lengths_m, long, strict=True):
        if not is_long:
            bridged_m += length_m
            continue
        piece = _piece(element, length_m)
        if pieces:
            _check_joint(pieces[-1], piece, bridged_m)
        pieces.append(piece)
        bridged_m = 0.0
    pieces[-1] = replace(pieces[-1], length_m=pieces[-1].length_m + bridged_m)
    return pieces


def _check_joint(here: Piece, there: Piece, bridged_m: float) -> None:
    """Raise InputError where ``there`` does not begin at the end of ``here``, or of the slivers behind it."""
    end_m, joint = here.start_m + here.length_m, "the end of the previous geometry"
    if abs(there.start_m - end_m) > JOINT_M + bridged_m:
        raise there.element.error(f"s={there.start_m:g}: expected {end_m:g}, {joint}")
    x, y, heading = here.pose(end_m)
    gap_m = math.hypot(there.origin[0] - x, there.origin[1] - y)
    turn_rad = abs(math.remainder(there.origin[2] - heading, math.tau))
    if gap_m > JOINT_M + bridged_m or turn_rad > (SLIVER_TURN_RAD if bridged_m else JOINT_RAD):
        raise there.element.error(f"starts {gap_m:.3f} m and {turn_rad:.3f} rad off {joint}")


def _length_m(element: Element) -> float:
    length_m = element.number("length", max_magnitude=MAX_LENGTH_M)
    if length_m < -LENGTH_ROUNDING_M:
        raise element.error(f"length={length_m:g}: expected more than 0 m")
    return max(length_m, 0.0)  # 0 is a sliver


def _piece(element: Element, length_m: float) -> Piece:
    origin = element.number("x"), element.number("y"), element.number("hdg")
    shapes = [
        child for child in element.all("*") if child.tag in SHAPES
    ]  # others are of the tool that wrote it
    if len(shapes) != 1:
        found = ", ".join(f"<{child.tag}>" for child in element.all("*")) or "nothing"
        raise element.error(f"expected one of {', '.join(SHAPES)}, got {found}")
    return Piece(element, element.number("s"), length_m, origin, _shape(shapes[0], length_m))


def _shape(element: Element, length_m: float) -> Shape:
    if element.tag == "line":
        return Clothoid(0.0)
    if element.tag == "arc":
        return Clothoid(element.number("curvature", max_magnitude=TIGHTEST_1PM))
    if element.tag == "spiral":
        start = element.number("curvStart", max_magnitude=TIGHTEST_1PM)
        end = element.number("curvEnd", max_magnitude=TIGHTEST_1PM)
        return Clothoid(start, (end - start) / length_m)
    if element.tag == "poly3":
        return Cubic(Polynomial([0.0, 1.0]), Polynomial([element.number(name) for name in "abcd"]), None)
    scales = {"arcLength": 1.0, "normalized": 1.0 / length_m}
    stated = element.attributes.get("pRange", "normalized")
    kind = next((name for name in scales if name.lower() == stated.lower()), None)
    if kind is None:
        raise element.error(f"pRange={stated!r}: expected {' or '.join(scales)}")
    u = Polynomial([element.number(f"{name}U") for name in "abcd"])
    v = Polynomial([element.number(f"{name}V") for name in "abcd"])
    cubic = Cubic(u, v, scales[kind])
    if not all(math.hypot(u.deriv()(p), v.deriv()(p)) > 0.0 for p in (0.0, length_m * scales[kind])):
        raise element.error("this curve has no direction at an end: expected bU or bV other than 0")
    return cubic
