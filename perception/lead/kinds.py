"""Kinds of road users in the boxes of a detector, and where they stand on the road.

The lower edge of a box is on the ground where the camera shows it; its distance deviates with that edge by a few
pixels. A person is of known height at most, so a box that is too high for its distance by the lower edge is cut off
below, by a parked car or the edge of the image: the distance by the greatest height is then an upper limit.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from perception.lead.detection import Detection
from trepid.car.camera import Camera
from trepid.types import Floats

VEHICLE, PERSON, CYCLIST, BICYCLE, ANIMAL = KINDS = ("vehicle", "person", "cyclist", "bicycle", "animal")
ROAD_USER_KINDS = (PERSON, CYCLIST, ANIMAL)
"""The kinds of a message :class:`~trepid.messages.RoadUsers`."""
HEIGHTS_M = {PERSON: (0.7, 2.1), CYCLIST: (1.0, 2.2), ANIMAL: (0.3, 1.8)}
"""A child to a tall adult; a dog to a horse."""
EDGE_SHARE, EDGE_PX = 0.04, 1.0  # deviation of the lower edge: of the height of the box, and at least
RIDES_SHARE = 0.3  # of the width of a bicycle that its rider covers
FARTHEST_M = 60.0  # a person is 6 px high at 320 px


class Box(NamedTuple):
    """A box [px] with its kind and probability."""

    kind: str
    corners: Floats  # left, top, right, bottom
    confidence: float


def detected_kinds(kinds: Sequence[str]) -> tuple[str, ...]:
    """The road users that a detector with classes of these ``kinds`` finds: a cyclist is a person on a bicycle."""
    cyclist = CYCLIST in kinds or (PERSON in kinds and BICYCLE in kinds)
    found = {PERSON: PERSON in kinds, CYCLIST: cyclist, ANIMAL: ANIMAL in kinds}
    return tuple(kind for kind, finds in found.items() if finds)


def with_cyclists(boxes: Sequence[Box]) -> list[Box]:
    """The road users in ``boxes``: a person on a bicycle is one cyclist, a bicycle alone is parked."""
    riders = {id(box): _bicycle_of(box, boxes) for box in boxes if box.kind == PERSON}
    found = []
    for box in boxes:
        bicycle = riders.get(id(box))
        if bicycle is not None:
            low, high = np.minimum(box.corners, bicycle.corners), np.maximum(box.corners, bicycle.corners)
            found.append(box._replace(kind=CYCLIST, corners=np.append(low[:2], high[2:])))
        elif box.kind not in (VEHICLE, BICYCLE):
            found.append(box)
    return found


def _bicycle_of(person: Box, boxes: Sequence[Box]) -> Box | None:
    """The bicycle that ``person`` sits on: it begins below the head and above the feet or lower."""
    left, top, right, bottom = person.corners
    for box in boxes:
        if box.kind != BICYCLE:
            continue
        overlap = min(right, box.corners[2]) - max(left, box.corners[0])
        rides = overlap >= RIDES_SHARE * (box.corners[2] - box.corners[0])
        if rides and top < box.corners[1] < bottom <= box.corners[3] + 0.3 * (bottom - top):
            return box
    return None


def standing(camera: Camera, box: Box) -> Detection | None:
    """The ground point of a road user with its deviation; None where no such one can stand there."""
    left, top, right, bottom = (float(corner) for corner in box.corners)
    middle = (left + right) / 2
    edge_px = max(EDGE_PX, EDGE_SHARE * (bottom - top))
    (at, nearer) = camera.road_from_pixel([(middle, bottom), (middle, bottom + edge_px)]).tolist()
    ahead_m, sigma_m = at[0], abs(at[0] - nearer[0])
    least_m, tallest_m = HEIGHTS_M[box.kind]
    at_most_m = camera.x_m + camera.fy_px * tallest_m / max(bottom - top, 1.0)
    if not camera.x_m < ahead_m <= at_most_m:  # above the horizon, or cut off below
        ahead_m, sigma_m = at_most_m, (1 - least_m / tallest_m) * at_most_m / 2
    depth_m = ahead_m - camera.x_m
    height_m = (bottom - top) * depth_m / camera.fy_px
    if not (least_m <= height_m and ahead_m <= FARTHEST_M and math.isfinite(sigma_m)):
        return None
    beside_m = camera.y_m + (camera.cx_px - middle) * depth_m / camera.fx_px
    width_m = (right - left) * depth_m / camera.fx_px
    confidence = min(max(box.confidence, 1e-3), 1 - 1e-3)
    left_m = at[1] if ahead_m == at[0] else beside_m
    return Detection(ahead_m, left_m, width_m, confidence, height_m, box.kind, sigma_m)
