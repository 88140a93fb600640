"""Labelled frames of random roads in random light, to train and to test lane estimators.

A seed determines one road with its curves, appearance and sky, so seed ranges can be divided between
processes. Labels are the geometry of the road at the drawn pose; nothing is measured in the image.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from typing import NamedTuple, TypeVar

import numpy as np

from learning.roadside import OPEN_COUNTRY, Scenery, things_beside
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.things import Thing
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.appearance import (
    Light,
    Marking,
    NeighbourLane,
    Paint,
    Section,
    Stroke,
    Surface,
    Verge,
)
from sim_harness.world.roads.disturbances import MAX_GRADE, Disturbance, DisturbanceKind, disturb
from sim_harness.world.roads.drawn import (
    SNOW_COVER,
    UNMARKED,
    BendShape,
    MarkingKind,
    random_section,
    random_segments,
    snow_on,
)
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from sim_harness.world.streets import Street, StreetKind, random_street
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.types import Image

E = TypeVar("E", bound=StrEnum)

AHEAD_M = 10.0  # over which the curvature rate is taken
MIN_RADIUS_M, MAX_RADIUS_M = 12.0, 120.0
MAX_HEADING_RAD = 1.4  # relative to the start, so that the road never crosses itself
ENTRY_M = (5.0, 12.0)  # shortest clothoids …
ARC_RAD = (0.3, 1.2)  # turn of an arc, without its clothoids
MAX_RATE_1PM2 = 1 / 60  # … and longer where this rate requires it: 2.8 m/s³ at 5.5 m/s
ROAD_M = 110.0
SECTION_M = (30.0, 70.0)
WIDTH_M, UNMARKED_WIDTH_M = (2.8, 3.8), (3.4, 5.0)  # of a lane; of a carriageway without lines
BOTH_WAYS, HALF_WIDTH_M = "both ways", (2.7, 3.7)  # name of a road for both ways without lines; of its half
MIDDLE_M, MIDDLE_SHARE, ANYWHERE_SHARE = 0.5, 0.25, 0.3  # places on it: up to its middle, over its half
SNOW_BANK_M = (0.0, 0.6)
CAMERAS_PER_ROAD = 4
PITCH_JITTER_RAD, HEIGHT_JITTER_M = 0.012, 0.04
MAX_OFFSET_M, MAX_HEADING_ERROR_RAD = 1.2, 0.3
LEAD_SHARE, GLARE_SHARE, BLIND_SHARE = 0.12, 0.08, 0.04
DRAWN_SHARE = 0.5  # share of roads of one kind of the benches; the others change every SECTION_M
DISTURBED_SHARE, SNOWED_UP_SHARE = 0.4, 0.06  # of the roads
STREET_FROM_M, STREET_M = 10.0, 50.0  # where vehicles stand in a street, and the length that is shown
STREETS = tuple(kind for kind in StreetKind if kind is not StreetKind.BARE)  # its lane cannot be seen
DISTURBANCES = tuple(kind for kind in DisturbanceKind if kind is not DisturbanceKind.TUNNEL_EXIT)


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneSample:
    """A frame and its true lane."""

    image: Image
    lane: Lane  # its curvature rate is the mean over the lane ahead
    lane_width_m: float
    visible: bool  # False: the light hides the lane; an estimate would be wrong
    carriageway: "Carriageway"


class Carriageway(NamedTuple):
    """What is paved about a lane, from edge to edge."""

    middle_m: float  # to the left of the middle of the lane
    width_m: float
    bare: bool | None  # without lines, also under snow; None: it has several lanes, but no lines


def road_samples(
    seed: int, camera: Camera, *, frames: int, scenery: Scenery = OPEN_COUNTRY, ahead_m: float = AHEAD_M
) -> Iterator[LaneSample]:
    """``frames`` frames of the road of ``seed``, in the order along the road: shuffle before training.

    The curvature rate of their lanes is the mean over ``ahead_m``.
    """
    rng = np.random.default_rng((seed, 10))
    street, things, (first_m, last_m) = _random_place(rng, np.random.default_rng((seed, 11)), scenery)
    disturbed_now = rng.random() < DISTURBED_SHARE
    disturbances = random_disturbances(rng, DISTURBANCES, MAX_GRADE) if disturbed_now else []
    road = Road(disturb(street.road.settings, disturbances))
    ground = Ground(road, seed=seed)
    cameras = [_jitter(camera, rng) for _ in range(CAMERAS_PER_ROAD)]

    @cache
    def renderer_of(number: int, mirror: bool) -> Renderer:
        eye = _mirror_camera(cameras[number]) if mirror else cameras[number]
        return Renderer(road, eye, seed=seed, ground=ground, disturbances=disturbances, things=things)

    for index, station_m in enumerate(np.sort(rng.uniform(first_m, last_m, frames)).tolist()):
        mirror = bool(rng.random() < 0.5)
        renderer = renderer_of(int(rng.integers(CAMERAS_PER_ROAD)), mirror)
        yield _sample(
            renderer, station_m, rng, index=index, mirror=mirror, vehicles=street.vehicles, ahead_m=ahead_m
        )


def _random_place(
    rng: np.random.Generator, town: np.random.Generator, scenery: Scenery
) -> tuple[Street, list[tuple[Pose, Thing]], tuple[float, float]]:
    """A road or street, the things beside it, and the stations that are shown.

    ``town`` draws what ``scenery`` adds, so that the roads of open country stay the same.
    """
    if town.random() < scenery.streets:
        kind = STREETS[int(town.integers(len(STREETS)))]
        shape = BendShape.BEND if town.random() < 0.5 else BendShape.STRAIGHT
        segments = random_segments(shape, town)
        street = random_street(kind, town, from_m=STREET_FROM_M, segments=segments)
        shown_m = (STREET_FROM_M, STREET_FROM_M + STREET_M)
    else:
        if scenery.highways and town.random() < scenery.highways:
            road = highway(town)
        else:
            road = drawn_road(rng) if rng.random() < DRAWN_SHARE else random_road(rng)
            if scenery.bare and town.random() < scenery.bare:
                road = drawn_road(town, kinds=UNMARKED)
            if scenery.both_ways and road.name in UNMARKED and town.random() < scenery.both_ways:
                road = add_other_half(road, float(town.uniform(*HALF_WIDTH_M)))
            if scenery.snow and town.random() < scenery.snow:
                road = snow_up(road, town)
        street, shown_m = Street(road, ()), (0.0, road.length_m)
    if scenery.seams and town.random() < scenery.seams:
        street = replace(street, road=add_seams(street.road, town))
    things = things_beside(street.road, town) if town.random() < scenery.things else []
    return street, things, shown_m


def _sample(
    renderer: Renderer,
    station_m: float,
    rng: np.random.Generator,
    *,
    index: int,
    mirror: bool,
    vehicles: tuple[tuple[Pose, Body], ...],
    ahead_m: float,
) -> LaneSample:
    """A frame at a random pose near ``station_m``, or its mirror image."""
    road = renderer.road
    offset_m = _random_offset(road, rng)
    heading_error = _near_zero(rng, 0.05, MAX_HEADING_ERROR_RAD)
    light, visible = _random_light(rng)
    x_m, y_m = road.position(station_m, offset_m)
    image = renderer.render(
        x_m,
        y_m,
        road.heading_at(station_m) + heading_error,
        t_s=float(index),
        station_m=station_m,
        lead=None if vehicles else _random_lead(road, station_m, rng),
        vehicles=vehicles,
        motion=ShutterMotion(float(rng.uniform(0, 12)), float(rng.normal(0, 0.2))),
        light=light,
    )
    lane = lane_at(road, station_m, offset_m, heading_error, ahead_m=ahead_m)
    paved = carriageway_at(road, station_m)
    return LaneSample(
        image=np.ascontiguousarray(image[:, ::-1]) if mirror else image,
        lane=Lane(*(-value for value in lane[:4])) if mirror else lane,
        lane_width_m=road.width_at(station_m),
        visible=visible,
        carriageway=paved._replace(middle_m=-paved.middle_m) if mirror else paved,
    )


def carriageway_at(road: Road, station_m: float) -> Carriageway:
    """The carriageway of ``road`` about its lane."""
    section = road.section_at(station_m)
    lined = any(
        line.stroke != Stroke.NONE for line in (section.left, section.right, section.middle, section.far_left)
    )
    divided = bool(section.left_lanes or section.right_lanes)
    return Carriageway(
        (section.paved_left_m - section.paved_right_m) / 2,
        road.width_at(station_m) + section.paved_left_m + section.paved_right_m,
        None if divided and not lined else not lined,
    )


def lane_at(
    road: Road, station_m: float, offset_m: float, heading_error_rad: float, *, ahead_m: float
) -> Lane:
    """The lane of a pose on ``road``; the curvature rate is the mean over ``ahead_m``."""
    curvature, ahead = road.curvature_at(station_m), road.curvature_at(station_m + ahead_m)
    return Lane(offset_m, heading_error_rad, curvature, (ahead - curvature) / ahead_m)


def random_road(rng: np.random.Generator) -> Road:
    """An open road of random curves, markings, surfaces, verges and shadows."""
    segments = _random_segments(rng)
    length_m = math.fsum(segment.length_m for segment in segments)
    lane_width_m = float(rng.uniform(*WIDTH_M))
    starts = [0.0]
    while starts[-1] < length_m - SECTION_M[1]:
        starts.append(starts[-1] + float(rng.uniform(*SECTION_M)))
    return Road(
        RoadSettings(
            name="random",
            closed=False,
            lane_width_m=lane_width_m,
            sun_azimuth_rad=float(rng.uniform(-1.5, 1.5)),
            segments=tuple(segments),
            sections=tuple(_random_section(rng, start, lane_width_m) for start in starts),
        )
    )


def drawn_road(rng: np.random.Generator, *, kinds: Sequence[MarkingKind] = tuple(MarkingKind)) -> Road:
    """An open road of random curves and of one of ``kinds``; some snowed up."""
    kind = kinds[int(rng.integers(len(kinds)))]
    section = random_section(kind, rng)
    if rng.random() < SNOWED_UP_SHARE:
        section = section.model_copy(update=snow_on(float(rng.uniform(*SNOW_COVER))))
    return Road(
        RoadSettings(
            name=kind,
            closed=False,
            lane_width_m=float(rng.uniform(*(UNMARKED_WIDTH_M if kind in UNMARKED else WIDTH_M))),
            sun_azimuth_rad=float(rng.uniform(-1.5, 1.5)),
            segments=tuple(_random_segments(rng)),
            sections=(section,),
        )
    )


def highway(rng: np.random.Generator) -> Road:
    """A carriageway of one direction with up to six lanes, dashed between them, and bends of R ≥ 300 m."""

    def line(stroke: Stroke, paint: Paint = Paint.WHITE) -> Marking:
        dash_m, gap_m = ((3.0, 9.0), (3.0, 12.0), (6.0, 12.0), (2.0, 4.0))[int(rng.integers(4))]
        width_m, wear = float(rng.uniform(0.10, 0.2)), float(rng.choice([0.0, rng.uniform(0, 0.6)]))
        return Marking(stroke=stroke, paint=paint, width_m=width_m, dash_m=dash_m, gap_m=gap_m, wear=wear)

    lanes = int(rng.integers(0, 4)), int(rng.integers(0, 3))
    median = line(Stroke.SOLID, Paint.YELLOW if rng.random() < 0.5 else Paint.WHITE)
    border, dashed = line(Stroke.SOLID), line(Stroke.DASHED)
    left_lanes, right_lanes = (
        tuple(NeighbourLane(marking=dashed if number < count - 1 else outermost) for number in range(count))
        for count, outermost in zip(lanes, (median, border), strict=True)
    )
    surface = Surface.CONCRETE if rng.random() < 0.4 else Surface.ASPHALT
    return Road(
        RoadSettings(
            name="highway",
            closed=False,
            lane_width_m=float(rng.uniform(3.2, 3.9)),
            sun_azimuth_rad=float(rng.uniform(-math.pi, math.pi)),
            segments=random_segments(BendShape.STRAIGHT, rng),
            sections=(
                Section(
                    name="highway",
                    start_m=0.0,
                    left=dashed if left_lanes else median,
                    right=dashed if right_lanes else border,
                    left_lanes=left_lanes,
                    right_lanes=right_lanes,
                    paved_left_m=float(rng.uniform(0.3, 3.0)),
                    paved_right_m=float(rng.uniform(0.3, 3.5)),
                    surface=surface,
                    surface_grey=float(
                        rng.uniform(0.35, 0.66) if surface == Surface.CONCRETE else rng.uniform(0.22, 0.5)
                    ),
                    patchiness=float(rng.uniform(0, 1)),
                    verge=_pick(rng, Verge, (0.4, 0.3, 0.3, 0.0)),
                    shadows=float(rng.uniform(0.2, 0.8)) if rng.random() < 0.15 else 0.0,
                ),
            ),
        )
    )


def add_other_half(road: Road, half_m: float) -> Road:
    """``road``, which has no lines, as the right half of a carriageway for both ways, each ``half_m`` wide."""
    return _change(road, {"paved_left_m": half_m}, name=BOTH_WAYS, lane_width_m=half_m)


def snow_up(road: Road, rng: np.random.Generator) -> Road:
    """``road`` under trodden snow, with a bank of snow along each of its edges."""
    snow = snow_on(float(rng.uniform(*SNOW_COVER)))
    snow |= {side: float(rng.uniform(*SNOW_BANK_M)) for side in ("snow_left_m", "snow_right_m")}
    return _change(road, snow)


def add_seams(road: Road, rng: np.random.Generator) -> Road:
    """``road`` with up to three tar seams along it: beside the lines, as of lanes paved one by one, or anywhere."""
    half_m = road.settings.lane_width_m / 2
    seams_m = [
        float(
            rng.choice([-1, 1]) * (half_m + rng.normal(0, 0.5))
            if rng.random() < 0.7
            else rng.uniform(-half_m, half_m)
        )
        for _ in range(int(rng.integers(1, 4)))
    ]
    return _change(road, {"seams_m": tuple(seams_m)})


def _change(road: Road, of_sections: dict[str, object], **of_road: object) -> Road:
    """``road`` with other values of these fields of all its sections, and of its settings."""
    sections = tuple(one.model_copy(update=of_sections) for one in road.sections)
    return Road(road.settings.model_copy(update={**of_road, "sections": sections}))


def random_disturbances(
    rng: np.random.Generator,
    kinds: Sequence[DisturbanceKind],
    most_grade: float,
    *,
    weights: Sequence[float] | None = None,
) -> list[Disturbance]:
    """One or two of ``kinds`` over the whole road, up to ``most_grade``; all equally often, or by weight."""
    shares = None if weights is None else np.array(weights) / sum(weights)
    chosen = rng.choice(len(kinds), int(rng.integers(1, 3)), replace=False, p=shares)
    return [Disturbance(kind=kinds[i], grade=float(rng.uniform(0.5, most_grade))) for i in chosen]


def _random_segments(rng: np.random.Generator) -> list[Segment]:
    """Straights and bends joined by clothoids, at least ROAD_M long."""
    segments: list[Segment] = []
    curvature = heading = length_m = 0.0
    while length_m < ROAD_M:
        target = _random_curvature(rng)
        entry_m = float(rng.uniform(*ENTRY_M)) + abs(target - curvature) / MAX_RATE_1PM2
        arc_m = min(float(rng.uniform(3, 35)), float(rng.uniform(*ARC_RAD)) / max(abs(target), 1e-3))
        after = heading + entry_m * (curvature + target) / 2 + arc_m * target
        unwinding = target * (ENTRY_M[1] + abs(target) / MAX_RATE_1PM2) / 2  # to a straight road
        if abs(after + unwinding) > MAX_HEADING_RAD:
            continue  # turns too far: draw another; a straight always fits
        segments.append(Segment(length_m=entry_m, curvature_1pm=(curvature, target)))
        segments.append(Segment(length_m=arc_m, curvature_1pm=target))
        curvature, heading, length_m = target, after, length_m + entry_m + arc_m
    return segments


def _random_curvature(rng: np.random.Generator) -> float:
    """Zero, or ±1/R; small radii are drawn more often, because their arcs are short."""
    if rng.random() < 0.2:
        return 0.0
    radius_m = MIN_RADIUS_M * (MAX_RADIUS_M / MIN_RADIUS_M) ** (rng.random() ** 2)
    return float(rng.choice([-1, 1])) / radius_m


def _random_section(rng: np.random.Generator, start_m: float, lane_width_m: float) -> Section:
    """One lane without markings, one lane with some, or two lanes."""
    kind = str(rng.choice(["unmarked", "one_lane", "two_lanes"], p=[0.3, 0.25, 0.45]))
    surface = _pick(rng, Surface, (0.75, 0.15, 0.10) if kind == "unmarked" else (0.85, 0.15, 0.0))
    wear = float(rng.choice([0.0, rng.uniform(0, 0.4), rng.uniform(0.4, 0.75)], p=[0.4, 0.35, 0.25]))
    none = Marking(stroke=Stroke.NONE)
    left = right = far_left = none
    paved_left_m = paved_right_m = 0.0
    if kind != "unmarked":
        paved_left_m, paved_right_m = (float(v) for v in rng.uniform(0.05, 0.9, 2))
        left, right = _random_marking(rng, wear), _random_marking(rng, wear, solid=0.85)
    if kind == "one_lane" and rng.random() < 0.35:  # one side only: the other is the edge of the carriageway
        if rng.random() < 0.5:
            left, paved_left_m = none, 0.0
        else:
            right, paved_right_m = none, 0.0
    if kind == "two_lanes":
        paved_left_m += lane_width_m
        far_left = _random_marking(rng, wear, solid=0.85) if rng.random() < 0.8 else none
    return Section(
        name=kind,
        start_m=start_m,
        left=left,
        right=right,
        far_left=far_left,
        paved_left_m=paved_left_m,
        paved_right_m=paved_right_m,
        edge_roughness_m=float(rng.uniform(0.0, 0.06)),
        surface=surface,
        surface_grey=float(rng.uniform(0.5, 0.68) if surface == Surface.CONCRETE else rng.uniform(0.22, 0.6)),
        patchiness=float(rng.uniform(0, 1)),
        verge=_pick(rng, Verge, (0.5, 0.2, 0.2, 0.1)),
        shadows=float(rng.uniform(0.3, 1.0)) if rng.random() < 0.25 else 0.0,
    )


def _random_marking(rng: np.random.Generator, wear: float, *, solid: float = 0.4) -> Marking:
    dash_m, gap_m = ((3.0, 6.0), (3.0, 3.0), (3.0, 9.0), (6.0, 6.0), (2.0, 4.0))[int(rng.integers(5))]
    return Marking(
        stroke=Stroke.SOLID if rng.random() < solid else Stroke.DASHED,
        paint=Paint.YELLOW if rng.random() < 0.3 else Paint.WHITE,
        width_m=float(rng.uniform(0.08, 0.2)),
        dash_m=dash_m,
        gap_m=gap_m,
        wear=wear,
    )


def _random_light(rng: np.random.Generator) -> tuple[Light, bool]:
    """Light, and whether the lane is visible in it."""
    if rng.random() < BLIND_SHARE:
        return _blinding_light(rng), False
    light = Light(
        gain=math.exp(np.clip(rng.normal(0, 0.2), -0.7, 0.35)),
        gamma=math.exp(rng.normal(0, 0.2)),
        glare=float(rng.uniform(0.2, 0.9)) if rng.random() < GLARE_SHARE else 0.0,
        haze=float(rng.uniform(0, 0.5)) if rng.random() < 0.3 else 0.0,
        noise=float(rng.uniform(0.5, 8)),
        blur_px=float(rng.uniform(0, 1.2)) if rng.random() < 0.4 else 0.0,
    )
    return light, True


def _blinding_light(rng: np.random.Generator) -> Light:
    """Darkness, over-exposure or fog that hides the lane."""
    noise = float(rng.uniform(2, 10))
    return (
        Light(gain=float(rng.uniform(0.005, 0.03)), noise=noise),
        Light(gain=float(rng.uniform(8, 20)), gamma=0.5, glare=1.0, noise=noise),
        Light(haze=float(rng.uniform(0.98, 1.0)), noise=noise),
    )[int(rng.integers(3))]


def _random_lead(road: Road, station_m: float, rng: np.random.Generator) -> tuple[float, float, float] | None:
    if rng.random() >= LEAD_SHARE:
        return None
    ahead_m = station_m + float(rng.uniform(8, 45))
    x_m, y_m = road.position(ahead_m, float(rng.normal(0, 0.3)))
    return x_m, y_m, road.heading_at(ahead_m) + float(rng.normal(0, 0.03))


def _random_offset(road: Road, rng: np.random.Generator) -> float:
    """An offset from the lane; on a road for both ways without lines, from its right half and up to the middle.

    There the lane is the half with the car. Mirror images show left halves, so in the middle either half is
    the lane equally often, and an estimate can only be uncertain.
    """
    middle_m = road.settings.lane_width_m / 2
    place = rng.random() if road.name == BOTH_WAYS else 1.0
    if place < MIDDLE_SHARE:
        return float(rng.uniform(middle_m - MIDDLE_M, middle_m))
    if place < MIDDLE_SHARE + ANYWHERE_SHARE:
        return float(rng.uniform(-MAX_OFFSET_M, middle_m))
    return _near_zero(rng, 0.25, MAX_OFFSET_M)


def _near_zero(rng: np.random.Generator, sigma: float, limit: float) -> float:
    """Mostly near zero, sometimes uniform within the limit."""
    if rng.random() < 0.6:
        return float(np.clip(rng.normal(0, sigma), -limit, limit))
    return float(rng.uniform(-limit, limit))


def _jitter(camera: Camera, rng: np.random.Generator) -> Camera:
    pitch_down_rad = camera.pitch_down_rad + float(rng.normal(0, PITCH_JITTER_RAD))
    height_m = camera.height_m + float(rng.normal(0, HEIGHT_JITTER_M))
    return camera.model_copy(update={"pitch_down_rad": pitch_down_rad, "height_m": height_m})


def _mirror_camera(camera: Camera) -> Camera:
    """The camera whose image, flipped left to right, is that of ``camera`` in the mirrored world."""
    cx_px = camera.width_px - 1 - camera.cx_px
    return camera.model_copy(update={"cx_px": cx_px, "y_m": -camera.y_m, "yaw_rad": -camera.yaw_rad})


def _pick(rng: np.random.Generator, choices: type[E], shares: tuple[float, ...]) -> E:
    return list(choices)[int(rng.choice(len(shares), p=shares))]
