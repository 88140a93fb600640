"""Random streets in a town: kerbs, two ways, parking and cycle lanes, parked cars; the kept lane is on the right.

Left-hand traffic is the mirror image.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.standing import PAINTS_BGR, VAN, VANS
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.roads.appearance import Light, Marking, NeighbourLane, Paint, Section, Stroke, Verge
from sim_harness.world.roads.drawn import NONE, BendShape, random_segments
from sim_harness.world.roads.features import MarkKind, RoadMark
from sim_harness.world.roads.road import Road, RoadSettings, Segment

DASHES_M = ((2.0, 4.0), (4.0, 2.0), (3.0, 6.0), (1.0, 5.0))  # of dashes and of gaps, in towns
SLOT_M = 7.0  # of a parked car
HOUSES = 0.7  # share of streets in town with rows of houses
HOUSE_M, GAPS = (8.0, 25.0), 0.2  # length of a front; share of gaps in a row
FOOTWAY_M = (1.5, 4.0)
FRONTS_BGR = ((90, 110, 150), (60, 75, 110), (150, 165, 175), (110, 115, 120), (70, 90, 140), (190, 200, 205))
OUT_OF_TOWN = 0.25  # share of streets with a verge instead of a pavement


class StreetKind(StrEnum):
    """Kinds of streets."""

    TWO_WAY = "two ways"  # dashed centre line, kerb
    EDGED = "two ways, edged"  # … and a line or a double line along the kerb
    PARKING = "parking strip"  # dashed centre line; parked cars beyond a line, or without one
    CYCLE = "cycle lane"  # dashed centre line; a line, 1.2 to 1.8 m of cycle lane, a kerb
    BARE = "two ways, bare"  # no line at all
    ONE_WAY = "one way"  # one lane between kerbs
    LANES = "four lanes"  # two lanes each way


@dataclass(frozen=True)
class Street:
    """A street and the vehicles in it."""

    road: Road
    vehicles: tuple[tuple[Pose, Body], ...]


def random_street(
    kind: StreetKind,
    rng: np.random.Generator,
    *,
    from_m: float,
    segments: tuple[Segment, ...] | None = None,
) -> Street:
    """A random street of this kind, nearly straight without ``segments``; vehicles lie beyond ``from_m``."""
    width_m = float(rng.uniform(3.0, 4.2) if kind == StreetKind.ONE_WAY else rng.uniform(2.7, 3.6))
    section, parked_m = _section(kind, rng)
    marks = []
    if rng.random() < 0.4:
        mark = MarkKind(str(rng.choice([MarkKind.ARROW_STRAIGHT, MarkKind.ARROW_LEFT, MarkKind.ZEBRA])))
        marks = [RoadMark(kind=mark, at_m=from_m + float(rng.uniform(5, 25)))]
    road = Road(
        RoadSettings(
            name=str(kind),
            closed=False,
            lane_width_m=width_m,
            sun_azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
            segments=segments or random_segments(BendShape.STRAIGHT, rng),
            sections=(section,),
            marks=tuple(marks),
        )
    )
    houses = [] if section.verge != Verge.PAVEMENT or rng.random() > HOUSES else _houses(road, rng, from_m)
    return Street(road, (*_vehicles(road, kind, parked_m, rng, from_m), *houses))


def _section(kind: StreetKind, rng: np.random.Generator) -> tuple[Section, float | None]:
    """The look of the street, and the distance [m] of the parked cars from the edge of the lane."""
    centre, parked_m = _line(rng, Stroke.DASHED), None
    look: dict[str, object] = {"left": centre, "right": NONE, "left_lanes": (NeighbourLane(),)}
    kerb = _line(rng)
    if rng.random() < 0.5:
        kerb = _line(rng, Stroke.DOUBLE_SOLID, paint=Paint.YELLOW)
    match kind:
        case StreetKind.EDGED:
            look |= {"right": kerb, "left_lanes": (NeighbourLane(marking=kerb),)}
        case StreetKind.PARKING:
            strip = _line(rng, Stroke.DASHED if rng.random() < 0.5 else Stroke.SOLID)
            look |= {
                "right": strip if rng.random() < 0.5 else NONE,
                "right_lanes": (NeighbourLane(width_m=2.1),),
            }
            parked_m = 1.0
        case StreetKind.CYCLE:
            strip = _line(rng, Stroke.DASHED if rng.random() < 0.5 else Stroke.SOLID)
            edge = kerb if rng.random() < 0.3 else NONE
            beside = NeighbourLane(width_m=float(rng.uniform(1.2, 1.8)), marking=edge)
            look |= {"right": strip, "right_lanes": (beside,)}
        case StreetKind.BARE:
            look |= {"left": NONE}
        case StreetKind.ONE_WAY:
            look |= {"left": NONE, "left_lanes": ()}
        case StreetKind.LANES:
            lane = NeighbourLane(marking=_line(rng, Stroke.DASHED))
            look |= {"left_lanes": (lane, NeighbourLane()), "right": NONE}
            if rng.random() < 0.5:
                look |= {"right": _line(rng, Stroke.DASHED), "right_lanes": (NeighbourLane(),)}
        case _:
            pass
    gutter_m = float(rng.uniform(0.0, 0.5))
    out_of_town = rng.random() < OUT_OF_TOWN
    verge = str(rng.choice([Verge.GRASS, Verge.SOIL, Verge.DRY_GRASS])) if out_of_town else Verge.PAVEMENT
    light = Light(gain=float(np.exp(rng.normal(-0.1, 0.4))), noise=float(rng.uniform(0.5, 4)))
    look |= {"paved_left_m": gutter_m, "paved_right_m": gutter_m, "edge_roughness_m": 0.0}
    look |= {"kerb_m": 0.0 if out_of_town else float(rng.uniform(0.1, 0.3)), "verge": verge, "light": light}
    look |= {"surface_grey": float(rng.uniform(0.28, 0.52)), "patchiness": float(rng.uniform(0, 1))}
    shadow = rng.random()
    if shadow < 0.2:
        look |= {"building_shadows": float(rng.uniform(0.2, 0.9))}
    elif shadow < 0.4:
        look |= {"shadows": float(rng.uniform(0.2, 0.9))}
    return Section.model_validate(look | {"name": str(kind), "start_m": 0.0}), parked_m


def _line(rng: np.random.Generator, stroke: Stroke = Stroke.SOLID, **fields: object) -> Marking:
    dash_m, gap_m = DASHES_M[int(rng.integers(len(DASHES_M)))]
    drawn = {"stroke": stroke, "width_m": float(rng.uniform(0.08, 0.15)), "dash_m": dash_m, "gap_m": gap_m}
    return Marking.model_validate(drawn | {"wear": float(rng.uniform(0, 0.6))} | fields)


def _vehicles(
    road: Road, kind: StreetKind, parked_m: float | None, rng: np.random.Generator, from_m: float
) -> list[tuple[Pose, Body]]:
    """Parked cars on the right, and at times on the far side; a leader; an oncoming car."""
    half_m, found = road.settings.lane_width_m / 2, []
    if parked_m is not None:
        share = float(rng.uniform(0.2, 0.9))
        for station_m in np.arange(from_m + 4, from_m + 60, SLOT_M):
            if rng.random() < share:
                found.append(_vehicle(road, station_m, -half_m - parked_m, rng))
    if kind != StreetKind.ONE_WAY and rng.random() < 0.4:
        found.append(_vehicle(road, from_m + float(rng.uniform(10, 50)), 2 * half_m, rng, turn_rad=np.pi))
    if rng.random() < 0.35:
        found.append(_vehicle(road, from_m + float(rng.uniform(9, 40)), 0.0, rng))
    return found


def _houses(road: Road, rng: np.random.Generator, from_m: float) -> list[tuple[Pose, Body]]:
    """A row of houses on each side, as boxes."""
    found = []
    for side in (1.0, -1.0):
        at_m = from_m - 5.0
        front_m = _half_road_m(road, side) + float(rng.uniform(*FOOTWAY_M))
        while at_m < from_m + 90.0:
            length_m, high_m = float(rng.uniform(*HOUSE_M)), float(rng.uniform(5.0, 14.0))
            front = np.array(FRONTS_BGR[int(rng.integers(len(FRONTS_BGR)))]) * rng.uniform(0.5, 1.1)
            blue, green, red = front.astype(int).tolist()
            house = Body(0.0, length_m, 8.0, high_m, high_m - 0.4, 0.0, (blue, green, red))
            if rng.random() > GAPS:
                x_m, y_m = road.position(at_m, side * (front_m + house.width_m / 2))
                found.append(((x_m, y_m, road.heading_at(at_m)), house))
            at_m += length_m + float(rng.exponential(0.5))
    return found


def _half_road_m(road: Road, side: float) -> float:
    """Distance of the edge of the carriageway from the middle of the kept lane."""
    section, own_m = road.sections[0], road.settings.lane_width_m
    lanes = section.left_lanes if side > 0 else section.right_lanes
    beyond_m = sum(own_m if lane.width_m is None else float(np.max(lane.width_m)) for lane in lanes)
    return own_m / 2 + beyond_m + (section.paved_left_m if side > 0 else section.paved_right_m)


def _vehicle(
    road: Road, station_m: float, left_m: float, rng: np.random.Generator, *, turn_rad: float = 0.0
) -> tuple[Pose, Body]:
    x_m, y_m = road.position(float(station_m), left_m + float(rng.normal(0, 0.1)))
    paint = PAINTS_BGR[int(rng.integers(len(PAINTS_BGR)))]
    body = replace(VAN if rng.random() < VANS else Body(), bgr=paint)
    return (x_m, y_m, road.heading_at(float(station_m)) + turn_rad + float(rng.normal(0, 0.02))), body
