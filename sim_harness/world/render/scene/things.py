"""Draws things that stand beside a road: blocks, houses, trees."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim_harness.world.render.scene.painter import NEAR_M, Colour, Painter, Pose
from trepid.car.camera import Camera
from trepid.types import Image

STOREY_M, WINDOW_M, SILL_M = (
    3.0,
    (1.1, 1.4),
    1.0,
)  # of a house; width and height of a window, its height above the floor
WINDOWS_M = 2.6  # from one window to the next
GLASS = (70, 62, 52)
TRUNK_BGR, TRUNK_SHARE = (52, 66, 84), 0.35  # of a tree; of its height
LEAVES = 7  # discs of a crown


class ThingShape(StrEnum):
    """What a thing looks like."""

    BLOCK = "block"  # of one colour: a wall, a hedge, a kerbstone, a post, a plate
    HOUSE = "house"  # a block with rows of windows
    TREE = "tree"  # a trunk and a crown


@dataclass(frozen=True, slots=True)
class Thing:
    """A thing on a rectangle of the ground: the pose is that of its middle, ``length_m`` lies along x."""

    shape: ThingShape
    length_m: float
    width_m: float
    height_m: float
    bgr: Colour
    above_m: float = 0.0  # height of its lower end


def draw_thing(image: Image, camera: Camera, thing: Thing, pose: Pose) -> None:
    """Draw ``thing`` at ``pose`` in the camera's vehicle frame into ``image``; nothing when it is behind."""
    if pose[0] + math.hypot(thing.length_m, thing.width_m) / 2 < camera.x_m + NEAR_M:
        return
    painter = Painter(image, camera, pose)
    half_m = thing.width_m / 2
    ends_m = (-thing.length_m / 2, thing.length_m / 2)
    match thing.shape:
        case ThingShape.TREE:
            _draw_tree(painter, thing)
        case ThingShape.BLOCK:
            painter.box(ends_m, half_m, half_m, (thing.above_m, thing.height_m), thing.bgr)
        case ThingShape.HOUSE:
            painter.box(ends_m, half_m, half_m, (0.0, thing.height_m), thing.bgr)
            for y_m in (-half_m, half_m):
                if painter.faces_side(y_m):
                    for x_m, z_m in _windows(thing):
                        corners = [(x_m, y_m, z_m), (x_m + WINDOW_M[0], y_m, z_m)]
                        corners += [(x, y, z + WINDOW_M[1]) for x, y, z in reversed(corners)]
                        painter.face(corners, GLASS)


def _windows(house: Thing) -> Iterator[tuple[float, float]]:
    """The lower rear corners (x, z) of the windows of a long side."""
    for x_m in np.arange(-house.length_m / 2 + 0.8, house.length_m / 2 - WINDOW_M[0], WINDOWS_M).tolist():
        for z_m in np.arange(SILL_M, house.height_m - WINDOW_M[1], STOREY_M).tolist():
            yield x_m, z_m


def _draw_tree(painter: Painter, tree: Thing) -> None:
    trunk_m = TRUNK_SHARE * tree.height_m
    thick_m = 0.02 * tree.height_m + 0.05
    painter.box((-thick_m, thick_m), thick_m, thick_m, (0.0, trunk_m), TRUNK_BGR)
    radius_m = tree.width_m / 2
    for number in range(LEAVES):
        turn = math.tau * number / LEAVES
        rise_m = trunk_m + (tree.height_m - trunk_m) * (0.25 + 0.5 * number / (LEAVES - 1))
        place = (0.45 * radius_m * math.cos(2.4 * turn), 0.45 * radius_m * math.sin(2.4 * turn), rise_m)
        shade = 0.75 + 0.5 * number / (LEAVES - 1)
        painter.disc(place, 0.6 * radius_m, tuple(min(shade * channel, 255.0) for channel in tree.bgr))
