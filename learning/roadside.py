"""What is beside random roads: towns, and random houses, walls, hedges, trees, posts and rails."""

import math
from enum import StrEnum

import numpy as np

from sim_harness.world.render.ground.strip_grid import edges_m
from sim_harness.world.render.scene.painter import Colour, Pose
from sim_harness.world.render.scene.things import Thing, ThingShape
from sim_harness.world.roads.road import Road
from trepid.config import Settings
from trepid.types import Share

PIECE_M = 4.0  # walls, hedges and rails follow bends in pieces of this length
CLEAR_M = 0.3  # least distance from the carriageway


class Scenery(Settings):
    """Shares of the random roads."""

    streets: Share  # in towns, with vehicles
    highways: Share = 0.0  # of those outside towns
    bare: Share = 0.0  # of those outside towns that are no highways, without lines
    both_ways: Share = 0.0  # of drawn roads without lines, for both ways: the lane is the half with the car
    snow: Share = 0.0  # of those outside towns that are no highways, under trodden snow
    seams: Share = 0.0  # with tar seams along the road
    things: Share  # with things beside the road


OPEN_COUNTRY = Scenery(streets=0.0, things=0.0)


class Roadside(StrEnum):
    """What stands along one side of a road."""

    NOTHING = "nothing"
    HOUSES = "houses"
    WALL = "wall"  # or a fence
    HEDGE = "hedge"
    TREES = "trees"
    POSTS = "posts"  # posts, lamps and signs
    RAIL = "rail"


SHARES = (0.2, 0.15, 0.12, 0.13, 0.2, 0.12, 0.08)


def things_beside(road: Road, rng: np.random.Generator) -> list[tuple[Pose, Thing]]:
    """One kind of thing along each side of ``road``, at times posts before it; world poses."""
    found = []
    for sign in (-1, 1):
        kind = tuple(Roadside)[int(rng.choice(len(Roadside), p=SHARES))]
        found += _row(road, kind, sign, CLEAR_M + float(rng.exponential(2.0)), rng)
        if rng.random() < 0.3:
            found += _row(road, Roadside.POSTS, sign, CLEAR_M, rng)
    return found


def _row(
    road: Road, kind: Roadside, sign: int, clear_m: float, rng: np.random.Generator
) -> list[tuple[Pose, Thing]]:
    """Things ``clear_m`` beside the right (sign −1) or left edge of the carriageway."""
    found = []
    like, at_m = _like(kind, rng), 0.0
    while kind is not Roadside.NOTHING and at_m < road.length_m:
        length_m = float(rng.uniform(8.0, 22.0)) if kind is Roadside.HOUSES else like.length_m
        thing = _another(like, length_m, rng) if kind in (Roadside.HOUSES, Roadside.TREES) else like
        middle_m = at_m + length_m / 2
        bulge_m = length_m**2 * abs(road.curvature_at(middle_m)) / 8  # of the road towards a straight front
        if bulge_m < clear_m and (kind not in (Roadside.HOUSES, Roadside.TREES) or rng.random() < 0.8):
            found.append((_beside(road, middle_m, sign, clear_m + thing.width_m / 2), thing))
        at_m += length_m + _pause_m(kind, rng)
    return found


def _like(kind: Roadside, rng: np.random.Generator) -> Thing:
    """The first of a row of things."""
    green = _colour(rng, (50, 95, 80), 0.35)
    match kind:
        case Roadside.HOUSES:
            return Thing(
                ThingShape.HOUSE, 12.0, 8.0, float(rng.uniform(4, 14)), _colour(rng, (120, 140, 165), 0.5)
            )
        case Roadside.TREES:
            return Thing(ThingShape.TREE, 0.4, float(rng.uniform(2, 7)), float(rng.uniform(3, 12)), green)
        case Roadside.HEDGE:
            return Thing(
                ThingShape.BLOCK, PIECE_M, float(rng.uniform(0.5, 2)), float(rng.uniform(0.5, 2.5)), green
            )
        case Roadside.RAIL:
            high_m = float(rng.uniform(0.6, 0.8))
            return Thing(
                ThingShape.BLOCK, PIECE_M, 0.1, high_m, _colour(rng, (165, 165, 165), 0.2), high_m - 0.3
            )
        case Roadside.POSTS:
            width_m, high_m = ((0.12, 1.0), (0.15, 6.0), (0.6, 2.2))[int(rng.integers(3))]
            above_m = 1.5 if width_m > 0.5 else 0.0  # the plate of a sign
            return Thing(ThingShape.BLOCK, 0.12, width_m, high_m, _colour(rng, (150, 150, 150), 0.6), above_m)
        case _:
            return Thing(
                ThingShape.BLOCK,
                PIECE_M,
                0.3,
                float(rng.uniform(0.6, 2.2)),
                _colour(rng, (130, 140, 150), 0.5),
            )


def _another(thing: Thing, length_m: float, rng: np.random.Generator) -> Thing:
    """A house or tree of the same row, of another size and colour."""
    size = float(rng.uniform(0.7, 1.3))
    width_m = thing.width_m if thing.shape is ThingShape.HOUSE else thing.width_m * size
    return Thing(thing.shape, length_m, width_m, thing.height_m * size, _colour(rng, thing.bgr, 0.2))


def _pause_m(kind: Roadside, rng: np.random.Generator) -> float:
    match kind:
        case Roadside.HOUSES:
            return float(rng.exponential(2.0))
        case Roadside.TREES:
            return float(rng.uniform(3.0, 15.0))
        case Roadside.POSTS:
            return float(rng.uniform(8.0, 30.0))
        case _:
            return 0.0  # pieces of one wall, hedge or rail


def _beside(road: Road, station_m: float, sign: int, beyond_m: float) -> Pose:
    right_m, left_m = (float(edge[0]) for edge in edges_m(road, np.array([station_m])))
    kerb_m = road.section_at(station_m).kerb_m
    x_m, y_m = road.position(station_m, sign * ((left_m if sign > 0 else right_m) + kerb_m + beyond_m))
    return x_m, y_m, road.heading_at(station_m)


def _colour(rng: np.random.Generator, bgr: tuple[float, float, float], spread: float) -> Colour:
    """A colour near ``bgr``: other brightness, and each channel a little different."""
    factors = math.exp(float(rng.normal(0, spread))) * np.exp(rng.normal(0, spread / 3, 3))
    blue, green, red = (int(v) for v in np.clip(np.array(bgr) * factors, 5, 250))
    return blue, green, red
