"""The lane as a clothoid in the frame of the rear axle, and its motion as the vehicle moves.

The lane centre is y(x) = -e - ψ·x + κ·x²/2 + κ'·x³/6 [m] for small angles: lateral offset e [m, + = vehicle left of
the centre], heading error ψ [rad, vehicle minus lane], curvature κ [1/m, + = bends left] and its rate κ' [1/m²],
all at the centre of the rear axle (Dickmanns and Mysliwetz, Recursive 3-D road and relative ego-state recognition,
IEEE PAMI 14(2), 1992). It moves by

    e' = v·sin(ψ + β)    s' = v·cos(ψ + β) / (1 - κ·e)    ψ' = r - κ·s'    κ' = const, dκ = κ'·ds

with the speed v, the yaw rate r and the drift β (course minus heading of the rear axle, 0 without tyre slip;
De Luca, Oriolo, Samson, Feedback control of a nonholonomic car-like robot, 1998, section 2.2). Three forms, each of
second order in the time step, solve it for different inputs:

- :meth:`Lane.in_frame_at`: a displacement of the vehicle or of a camera, to the side too; linear in ψ,
- :func:`advance_clothoid`: a way along the lane and a turn, for numbers and arrays; with sin ψ, without 1 - κ·e,
- :func:`lane_after`: speed, yaw rate and drift over many short steps; with sin ψ, 1 - κ·e and the end of the lane.

They differ in terms of third order, so that exchanging one for another changes results beyond rounding.

Messages (`SteeringEstimate`, `Decision`) carry the curvature at their look-ahead ℓ instead of at the axle. The only
conversions are :meth:`Lane.of_message` and :meth:`Lane.curvature_at`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from trepid.bounds import at_least, at_most
from trepid.messages import Decision, SteeringEstimate
from trepid.types import Array

T = TypeVar("T", float, Array)

_MIN_RADIUS_SHARE = 0.2  # of 1 - κ·e: close to the centre of the bend "along the lane" loses its meaning


class Motion(NamedTuple):
    """Speed of the rear axle [m/s] and yaw rate [rad/s, + left]."""

    speed_mps: float
    yaw_rate_radps: float

    def over(self, dt_s: float) -> tuple[float, float, float]:
        """Displacement (x [m], y [m], yaw [rad]) after ``dt_s`` in the frame before it."""
        yaw_rad = self.yaw_rate_radps * dt_s
        return *chord(self.speed_mps * dt_s, yaw_rad), yaw_rad


STANDING = Motion(0.0, 0.0)


def chord(arc_m: float, turned_rad: float) -> tuple[float, float]:
    """End (x, y) [m] of an arc of length ``arc_m`` that starts along x and turns by ``turned_rad``.

    The length of the chord is taken as that of the arc: an error of third order.
    """
    return arc_m * math.cos(turned_rad / 2), arc_m * math.sin(turned_rad / 2)


class Lane(NamedTuple):
    """Lane centre as a clothoid, known up to ``lookahead_m`` ahead of the rear axle."""

    offset_m: float
    heading_rad: float
    curvature_1pm: float  # at the axle
    curvature_rate_1pm2: float
    lookahead_m: float = math.inf

    @classmethod
    def of_message(cls, message: SteeringEstimate | Decision, *, known_m: float = math.inf) -> "Lane | None":
        """The lane of a message with its curvature brought to the axle, κ = κ(ℓ) - κ'·ℓ, known up to ``known_m``.

        None without offset, heading or curvature; without a rate the lane is an arc, κ' = 0. The numbers are not
        checked.
        """
        offset_m, heading_rad = message.lateral_offset_m, message.heading_error_rad
        if offset_m is None or heading_rad is None or message.curvature_1pm is None:
            return None
        rate_1pm2 = message.curvature_rate_1pm2 or 0.0
        curvature_1pm = message.curvature_1pm - rate_1pm2 * message.lookahead_m
        return cls(offset_m, heading_rad, curvature_1pm, rate_1pm2, known_m)

    def curvature_at(self, ahead_m: float) -> float:
        """κ(x) = κ + κ'·x [1/m]; constant beyond the look-ahead."""
        return self.curvature_1pm + self.curvature_rate_1pm2 * at_most(ahead_m, self.lookahead_m)

    def y_m(self, x_m: float) -> float:
        """Lateral position y(x) [m] of the lane centre, + left."""
        offset_m, heading_rad, curvature_1pm, rate_1pm2, _ = self
        curve = curvature_1pm / 2 + rate_1pm2 * x_m / 6
        return -offset_m - heading_rad * x_m + curve * x_m**2

    def slope_at(self, x_m: float) -> float:
        """dy/dx of the lane centre at ``x_m``."""
        return -self.heading_rad + self.curvature_1pm * x_m + self.curvature_rate_1pm2 * x_m**2 / 2

    def path_curvature(self, curvature_1pm: float) -> float:
        """Curvature [1/m] that keeps offset and heading error where the lane bends by ``curvature_1pm``.

        κ·cos ψ / (1 - κ·e): on the inside of a bend the car must turn tighter than the lane.
        """
        return curvature_1pm * math.cos(self.heading_rad) / _radius_share(curvature_1pm, self.offset_m)

    def pursuit_curvature(self, lookahead_m: float) -> float:
        """Curvature κ_cmd [1/m], + left, of the arc from the axle to the lane centre at ``lookahead_m``."""
        return pursuit_curvature(self.y_m(lookahead_m), lookahead_m)

    def plus(self, other: "Lane", weight: float) -> "Lane":
        """This lane and ``weight`` times ``other``, component by component. Known without limit."""
        return Lane(*(a + weight * b for a, b in zip(self[:4], other[:4], strict=True)))

    def in_frame_at(self, x_m: float, y_m: float, yaw_rad: float = 0.0) -> "Lane":
        """The lane in the frame at ``x_m``, ``y_m`` [m], turned by ``yaw_rad``: e - y(x), ψ - y'(x), κ + κ'·x."""
        _, heading_rad, curvature_1pm, rate_1pm2, lookahead_m = self
        bend_rad = curvature_1pm * x_m + rate_1pm2 * x_m**2 / 2
        return Lane(
            y_m - self.y_m(x_m),
            heading_rad + yaw_rad - bend_rad,
            curvature_1pm + rate_1pm2 * x_m,
            rate_1pm2,
            at_least(lookahead_m - x_m, 0.0),
        )

    def after(self, motion: Motion, dt_s: float) -> "Lane":
        """The lane in the frame of the vehicle ``dt_s`` later."""
        return self.in_frame_at(*motion.over(dt_s))


LaneFields = tuple[float, float, float, float, float]
"""The fields of a :class:`Lane` as a bare tuple, for many short steps in a row."""


def pursuit_curvature(y_m: float, lookahead_m: float) -> float:
    """κ_cmd = 2·y/ℓ² [1/m] of the arc from the axle to the point (ℓ, y), with ℓ measured along x.

    Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, eq. 3 with D² = ℓ² for
    small y.
    """
    return 2 * y_m / lookahead_m**2


def mean_lane(lanes: list[Lane], weights: list[float]) -> Lane:
    """Mean of lanes, component by component; ``weights`` sum to 1. Known without limit."""
    offset_m = heading_rad = curvature_1pm = curvature_rate_1pm2 = 0.0
    for (offset, heading, curvature, rate, _), weight in zip(lanes, weights, strict=True):
        offset_m += weight * offset
        heading_rad += weight * heading
        curvature_1pm += weight * curvature
        curvature_rate_1pm2 += weight * rate
    return Lane(offset_m, heading_rad, curvature_1pm, curvature_rate_1pm2)


def advance_clothoid(
    offset_m: T,
    heading_rad: T,
    curvature_1pm: T,
    curvature_rate_1pm2: T,
    *,
    way_m: float,
    turned_rad: T,
    sin: Callable[[T], T],
) -> tuple[T, T, T]:
    """Offset, heading and curvature after ``way_m`` along the lane with the vehicle turned by ``turned_rad``.

    e + s·sin(mean ψ), ψ + φ - κ·s - κ'·s²/2, κ + κ'·s, for floats or arrays of one shape.
    """
    turn_rad = turned_rad - curvature_1pm * way_m
    return (
        offset_m + way_m * sin(heading_rad + turn_rad / 2),
        heading_rad + (turn_rad - curvature_rate_1pm2 * way_m**2 / 2),
        curvature_1pm + curvature_rate_1pm2 * way_m,
    )


def lane_after(
    lane: LaneFields, dt_s: float, speed_mps: float, yaw_rate_radps: float, drift_rad: float = 0.0
) -> LaneFields:
    """The lane ``dt_s`` later by the equations above (midpoint rule), its look-ahead shortened by the way."""
    middle = _shift_lane(lane, 0.5 * dt_s, lane, speed_mps, yaw_rate_radps, drift_rad)
    return _shift_lane(lane, dt_s, middle, speed_mps, yaw_rate_radps, drift_rad)


def _shift_lane(
    lane: LaneFields, dt_s: float, by: LaneFields, speed_mps: float, yaw_rate_radps: float, drift_rad: float
) -> LaneFields:
    """``lane`` from ``dt_s`` later at the rates s', e', ψ' that hold at ``by``."""
    offset_m, heading_rad, curvature_1pm, rate_1pm2, lookahead_m = lane
    by_offset_m, by_heading_rad, by_curvature_1pm, _, _ = by
    course_rad = by_heading_rad + drift_rad
    along_mps = speed_mps * math.cos(course_rad) / _radius_share(by_curvature_1pm, by_offset_m)
    along_m = dt_s * along_mps
    known = along_m < lookahead_m
    return (
        offset_m + dt_s * (speed_mps * math.sin(course_rad)),
        heading_rad + dt_s * (yaw_rate_radps - by_curvature_1pm * along_mps),
        curvature_1pm + rate_1pm2 * (along_m if known else lookahead_m),
        rate_1pm2 if known else 0.0,
        lookahead_m - along_m if known else 0.0,
    )


def _radius_share(curvature_1pm: float, offset_m: float) -> float:
    return at_least(1.0 - curvature_1pm * offset_m, _MIN_RADIUS_SHARE)
