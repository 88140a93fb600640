"""The separation of two vehicles, as rectangles on the ground."""

import math
from dataclasses import dataclass


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
