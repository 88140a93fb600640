"""What is drawn on the camera picture: boundaries of each estimate, fused path, the vehicle and the people ahead.

All in pixels of the working image; the browser draws the lines, sharp at any size of the page.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import Decision, LeadVehicle, RoadUsers, SteeringEstimate
from trepid.types import Array

POINTS = 24  # of the path
SIGHT = 2.5  # the path is drawn to this multiple of its look-ahead
PATH_M = 0.35  # width of the drawn path in the reference world
LEAD_HEIGHT = 0.8  # of the drawn box, relative to its width
PEOPLE_M = {
    "cyclist": (0.6, 1.8),
    "animal": (0.6, 0.8),
}  # width and height of the drawn box, in the world of roads
PERSON_M = (0.6, 1.8)
Box = list[float]


def overlay(
    estimates: Iterable[SteeringEstimate],
    decision: Decision | None,
    lead: LeadVehicle | None,
    camera: Camera,
    vehicle: Vehicle,
    road_users: RoadUsers | None = None,
) -> dict[str, Any]:
    """Lines by estimator, the outline of the path, the box of the vehicle ahead; null where there is none.

    ``people``: kind, distance ahead [m] and box of every person, cyclist and animal in view.
    """
    return {
        "width": camera.width_px,
        "height": camera.height_px,
        "lanes": {one.estimator: lane_px(one, camera, vehicle) for one in estimates},
        "path": None if decision is None else path_px(decision, camera, vehicle),
        "lead": None if lead is None else lead_px(lead, camera, vehicle),
        "people": [] if road_users is None else people_px(road_users, camera, vehicle),
    }


def lane_px(estimate: SteeringEstimate, camera: Camera, vehicle: Vehicle) -> dict[str, Any]:
    """The boundaries of the lane: those that the estimator found, else those of its lane state and width."""
    left, right = estimate.left_boundary_px, estimate.right_boundary_px
    lane = Lane.of_message(estimate)
    if not (left or right) and lane is not None:
        x_m = _ahead_m(camera, estimate.lookahead_m)
        y_m = np.array([lane.y_m(float(x)) for x in x_m])
        half_m = (estimate.lane_width_m or vehicle.lane_width_m) / 2
        left, right = (
            tuple(map(tuple, camera.pixel_from_road(np.column_stack([x_m, y_m + side * half_m])).tolist()))
            for side in (1, -1)
        )
    return {"left": _round(left), "right": _round(right), "confidence": round(estimate.confidence, 2)}


def _ahead_m(camera: Camera, lookahead_m: float) -> Array:
    """Distances from the nearest road in the picture to SIGHT times the look-ahead, denser near the car."""
    nearest_m = float(camera.road_from_pixel([[camera.cx_px, camera.height_px]])[0][0])
    first_m = max(nearest_m, 0.1) if math.isfinite(nearest_m) else 0.1
    return np.geomspace(first_m, max(SIGHT * lookahead_m, 2 * first_m), POINTS)


def path_px(decision: Decision, camera: Camera, vehicle: Vehicle) -> list[list[float]] | None:
    """Outline of the fused path as a strip on the road, shape (n, 2); None without a path in view."""
    lane = Lane.of_message(decision)
    if lane is None:
        return None
    x_m = _ahead_m(camera, decision.lookahead_m)
    y_m = np.array([lane.y_m(float(x)) for x in x_m])
    half_m = PATH_M * vehicle.scale / 2
    left = camera.pixel_from_road(np.column_stack([x_m, y_m + half_m]))
    right = camera.pixel_from_road(np.column_stack([x_m, y_m - half_m]))
    outline = np.concatenate([left, right[::-1]])
    if not np.isfinite(outline).all():
        return None
    return _round(outline.tolist())


def lead_px(lead: LeadVehicle, camera: Camera, vehicle: Vehicle) -> Box | None:
    """Box (left, top, right, bottom) around the rear of the vehicle ahead, as wide as the own one; None unseen."""
    if (
        lead.distance_m is None
        or lead.lateral_m is None
        or not math.isfinite(lead.distance_m + lead.lateral_m)
    ):
        return None
    x_m = vehicle.wheelbase_m + vehicle.front_overhang_m + lead.distance_m
    half_m = vehicle.track_m / 2
    feet = camera.pixel_from_road([[x_m, lead.lateral_m + half_m], [x_m, lead.lateral_m - half_m]])
    if not np.isfinite(feet).all():
        return None
    (left, bottom), (right, _) = feet.tolist()
    return [round(value, 1) for value in (left, bottom - LEAD_HEIGHT * (right - left), right, bottom)]


def corners_px(box: Box) -> list[list[float]]:
    """The four corners of a box (left, top, right, bottom), clockwise from the upper left one."""
    left, top, right, bottom = box
    return [[left, top], [right, top], [right, bottom], [left, bottom]]


def size_m(kind: str, vehicle: Vehicle) -> tuple[float, float]:
    """Width and height of a road user of ``kind`` as it is drawn [m]."""
    wide_m, high_m = PEOPLE_M.get(kind, PERSON_M)
    return wide_m * vehicle.scale, high_m * vehicle.scale


def ahead_text(kind: str, distance_m: float) -> str:
    """A road user in words: ``person 6 m``."""
    return f"{kind} {distance_m:.0f} m"


def people_px(road_users: RoadUsers, camera: Camera, vehicle: Vehicle) -> list[dict[str, Any]]:
    """Kind, distance from the front bumper [m] and upright box of every road user in view, the farthest first."""
    nose_m, found = vehicle.wheelbase_m + vehicle.front_overhang_m, []
    for kind, x_m, y_m in zip(road_users.kinds, road_users.x_m, road_users.y_m, strict=False):
        depth_m = x_m - camera.x_m
        if not (math.isfinite(depth_m + y_m) and depth_m > 0.1):
            continue
        (middle, bottom) = camera.pixel_from_road([[x_m, y_m]])[0].tolist()
        wide_m, high_m = size_m(kind, vehicle)
        half_px, high_px = camera.fx_px * wide_m / depth_m / 2, camera.fy_px * high_m / depth_m
        box = (middle - half_px, bottom - high_px, middle + half_px, bottom)
        if all(map(math.isfinite, box)):
            found.append(
                {
                    "kind": kind,
                    "distance": round(max(x_m - nose_m, 0.0), 1),
                    "box": [round(p, 1) for p in box],
                }
            )
    return sorted(found, key=lambda one: -one["distance"])


def _round(points: Iterable[Sequence[float]]) -> list[list[float]]:
    """``points`` without those that are not finite."""
    return [[round(value, 1) for value in point] for point in points if all(map(math.isfinite, point))]
