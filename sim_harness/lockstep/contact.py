"""Vehicles as rectangles on the ground: the separation of two, and how much of a body they leave in sight."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Outline:
    """The outline of a vehicle; x is counted from its rear axle."""

    x_m: float
    y_m: float
    yaw_rad: float
    rear_m: float
    front_m: float
    width_m: float

    def at(self, x_m: float, y_m: float = 0.0) -> tuple[float, float]:
        """A point given in the axes of the vehicle."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.x_m + x_m * cos - y_m * sin, self.y_m + x_m * sin + y_m * cos

    def in_axes(self, x_m: float, y_m: float) -> tuple[float, float]:
        """A point of the ground in the axes of the vehicle: the inverse of :meth:`at`."""
        return along_and_across(x_m - self.x_m, y_m - self.y_m, self.yaw_rad)

    def corners(self) -> list[tuple[float, float]]:
        """The four corners."""
        half_m = self.width_m / 2
        return [self.at(x, y) for x in (self.rear_m, self.front_m) for y in (-half_m, half_m)]


def separation_m(a: Outline, b: Outline) -> float:
    """The widest gap [m] between two boxes across any of their sides; ≤ 0 if and only if they touch.

    Two convex shapes are apart if and only if a line along a side of one of them separates them (separating
    axis theorem: Ericson, Real-Time Collision Detection (2005), section 5.2.1). Between two parallel sides the
    gap is the distance; between two corners it is at most √2 smaller.
    """
    ax, ay = a.at((a.rear_m + a.front_m) / 2)
    bx, by = b.at((b.rear_m + b.front_m) / 2)
    turn_rad = b.yaw_rad - a.yaw_rad
    cos, sin = abs(math.cos(turn_rad)), abs(math.sin(turn_rad))
    gaps = []
    for one, other in ((a, b), (b, a)):
        ahead_m, beside_m = along_and_across(bx - ax, by - ay, one.yaw_rad)
        half_m, other_half_m = (one.front_m - one.rear_m) / 2, (other.front_m - other.rear_m) / 2
        gaps.append(abs(ahead_m) - half_m - other_half_m * cos - other.width_m / 2 * sin)
        gaps.append(abs(beside_m) - one.width_m / 2 - other_half_m * sin - other.width_m / 2 * cos)
    return max(gaps)


def along_and_across(dx_m: float, dy_m: float, yaw_rad: float) -> tuple[float, float]:
    """The components of a displacement along and across a heading."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return dx_m * cos + dy_m * sin, dy_m * cos - dx_m * sin


ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)  # places of the tested points, in widths of the body
UP = (0.1, 0.3, 0.5, 0.7, 0.9)  # in heights of the body


class Solid(NamedTuple):
    """An upright box on the ground."""

    box: Outline
    height_m: float


def seen_share(eye_m: tuple[float, float, float], body: Solid, vehicles: Iterable[Solid]) -> float:
    """Share of the points on the middle plane of ``body``, across the line of sight, to which a free line leads.

    ``eye_m``: x, y, z of the lens in world axes.
    """
    solids = list(vehicles)
    box = body.box
    x_m, y_m = box.at((box.rear_m + box.front_m) / 2)
    away_m = ((x_m - eye_m[0]) ** 2 + (y_m - eye_m[1]) ** 2) ** 0.5
    left = (0.0, 0.0) if away_m == 0.0 else ((eye_m[1] - y_m) / away_m, (x_m - eye_m[0]) / away_m)
    free = 0
    for across in ACROSS:
        side_m = across * box.width_m
        for up in UP:
            point_m = (x_m + side_m * left[0], y_m + side_m * left[1], up * body.height_m)
            free += not any(_hides(solid, eye_m, point_m) for solid in solids)
    return free / (len(ACROSS) * len(UP))


def _hides(solid: Solid, eye_m: tuple[float, float, float], point_m: tuple[float, float, float]) -> bool:
    """Whether the straight line from the eye to the point meets the solid.

    Slabs: Kay and Kajiya, Ray tracing complex scenes (1986). The line is eye + t·(point - eye), t in 0..1.
    """
    box = solid.box
    start = (*box.in_axes(*eye_m[:2]), eye_m[2])
    along_m, across_m = along_and_across(point_m[0] - eye_m[0], point_m[1] - eye_m[1], box.yaw_rad)
    run = (along_m, across_m, point_m[2] - eye_m[2])
    half_m = box.width_m / 2
    first, last = 0.0, 1.0
    for from_m, by_m, low_m, high_m in zip(
        start, run, (box.rear_m, -half_m, 0.0), (box.front_m, half_m, solid.height_m), strict=True
    ):
        if by_m == 0.0:
            if not low_m <= from_m <= high_m:
                return False
            continue
        enters, leaves = sorted(((low_m - from_m) / by_m, (high_m - from_m) / by_m))
        first, last = max(first, enters), min(last, leaves)
    return first <= last
