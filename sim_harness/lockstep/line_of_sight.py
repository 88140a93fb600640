"""How much of a body the vehicles between it and the lens leave in sight."""

from collections.abc import Iterable
from typing import NamedTuple

from sim_harness.lockstep.contact import Outline, along_and_across

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
