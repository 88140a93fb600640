"""Random roads by kind of marking or surface and by kind of bend, for the benches of perception and fear."""

from enum import StrEnum
from functools import partial

import numpy as np

from sim_harness.world.roads.appearance import Marking, NeighbourLane, Paint, Section, Stroke, Surface, Verge
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint
from sim_harness.world.roads.road import Road, RoadSettings, Segment

NONE = Marking(stroke=Stroke.NONE)
LEAD_IN_M, LEAD_OUT_M = 25.0, 90.0
DASHES_M = ((3.0, 6.0), (3.0, 9.0), (6.0, 12.0), (4.0, 8.0), (2.0, 4.0))  # of dashes and of gaps
SNOW_COVER = (0.3, 0.9)  # range, for roads under snow
VERGES = (Verge.GRASS, Verge.DRY_GRASS, Verge.SOIL, Verge.PAVEMENT)
VERGE_SHARES = (0.5, 0.2, 0.15, 0.15)
MAX_RATE_1PM2 = 1 / 120  # of curvature along an entry: R = 12 m after 10 m
ARC_RAD = (0.7, 1.3)  # turn of an arc, without its clothoids
STEEPEST, MOST_BANK_RAD = 0.12, 0.06  # of random hills
HILL_M = (75.0, 120.0)  # from one grade to the next: crests of 300 m radius and more
SPEEDS_MPS = {"straight": 10.0, "bend": 8.0, "tight": 5.0}


class MarkingKind(StrEnum):
    """Kinds of markings, and of surfaces without markings."""

    WHITE = "white"  # two lanes, dashed centre line, solid edges
    YELLOW = "yellow"  # solid yellow centre line
    DOUBLE = "double"  # two yellow lines side by side
    DASHED = "dashed"  # dashed on both sides, lanes on both sides
    ONE_LINE = "one line"  # left or right only; the edge of the other side is far away
    WORN = "worn"  # half of the paint worn off, patched asphalt
    CONCRETE = "concrete"  # white on pale grey
    INTERRUPTED = "interrupted"  # pieces of 6 to 15 m missing
    MULTI_LANE = "multi-lane"  # four or five lanes
    ASPHALT = "unmarked asphalt"  # one carriageway of asphalt in grass
    BROKEN = "broken asphalt"  # ragged edges, patches, soil verge
    GRAVEL = "gravel"  # gravel in dry grass


UNMARKED = (MarkingKind.ASPHALT, MarkingKind.BROKEN, MarkingKind.GRAVEL)


class BendShape(StrEnum):
    STRAIGHT = "straight"  # R ≥ 300 m
    BEND = "bend"  # R = 40 to 120 m
    TIGHT = "tight"  # R = 12 to 30 m


RADII_M = {BendShape.STRAIGHT: (300.0, 1500.0), BendShape.BEND: (40.0, 120.0), BendShape.TIGHT: (12.0, 30.0)}


def random_road(
    kind: MarkingKind,
    shape: BendShape,
    rng: np.random.Generator,
    *,
    gap_m: tuple[float, float] | None = None,
    snow_cover: float = 0.0,
    hilly: bool = False,
) -> Road:
    """A random road of this kind and shape.

    ``gap_m``: stations between which both lines of the lane are missing; ``snow_cover``: share of the carriageway
    under trodden snow; ``hilly``: with a random height and bank.
    """
    section = random_section(kind, rng)
    if snow_cover > 0:
        section = section.model_copy(update=snow_on(snow_cover))
    if gap_m is not None:
        left, right = (line.model_copy(update={"gaps_m": (gap_m,)}) for line in (section.left, section.right))
        section = section.model_copy(update={"left": left, "right": right})
    width_m = float(rng.uniform(3.4, 5.0) if kind in UNMARKED else rng.uniform(2.9, 3.75))
    settings = RoadSettings(
        name=f"{kind}, {shape}",
        closed=False,
        lane_width_m=width_m,
        sun_azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
        segments=random_segments(shape, rng, straight_m=0.0 if gap_m is None else gap_m[1]),
        sections=(section,),
    )
    return Road(with_hills(settings, rng) if hilly else settings)


def with_hills(
    settings: RoadSettings,
    rng: np.random.Generator,
    *,
    steepest: float = STEEPEST,
    bank_rad: float = MOST_BANK_RAD,
) -> RoadSettings:
    """The road with a random height and bank: grades up to ``steepest``, rising and falling in turn.

    A closed road returns to the height of its start: all its grades change by the same, small amount.
    """
    length_m = sum(segment.length_m for segment in settings.segments)
    count = max(int(length_m / np.mean(HILL_M)), 1)
    if settings.closed:
        count += count % 2  # turns that close
    spans_m = rng.uniform(*HILL_M, count)
    stations_m = np.concatenate([[0.0], np.cumsum(spans_m)[:-1]]) * length_m / spans_m.sum()
    grades = rng.uniform(0.3, 1.0, count) * np.where(np.arange(count) % 2, -1, 1) * rng.choice([-1, 1])
    if settings.closed:
        ends = np.append(stations_m, length_m)
        rise = np.diff(ends) * (grades + np.roll(grades, -1)) / 2
        grades -= rise.sum() / length_m
    grades *= steepest / max(np.abs(grades).max(), 1.0)
    banks = rng.uniform(-bank_rad, bank_rad, count)
    return settings.model_copy(
        update={
            "elevation": tuple(
                ElevationPoint(at_m=at_m, grade=grade)
                for at_m, grade in zip(stations_m.tolist(), grades.tolist(), strict=True)
            ),
            "bank": tuple(
                BankPoint(at_m=at_m, bank_rad=rad)
                for at_m, rad in zip(stations_m.tolist(), banks.tolist(), strict=True)
            ),
        }
    )


def random_segments(
    shape: BendShape, rng: np.random.Generator, *, straight_m: float = 0.0
) -> tuple[Segment, ...]:
    """A straight of 25 m or more, a bend to either side with clothoids, a straight."""
    low_m, high_m = RADII_M[shape]
    curvature = float(rng.choice([-1, 1])) / float(low_m * (high_m / low_m) ** rng.random())
    entry_m = max(10.0, abs(curvature) / MAX_RATE_1PM2)
    arc_m = min(float(rng.uniform(*ARC_RAD)) / abs(curvature), 80.0)
    return (
        Segment(length_m=LEAD_IN_M + straight_m),
        Segment(length_m=entry_m, curvature_1pm=(0.0, curvature)),
        Segment(length_m=arc_m, curvature_1pm=curvature),
        Segment(length_m=entry_m, curvature_1pm=(curvature, 0.0)),
        Segment(length_m=LEAD_OUT_M),
    )


def random_section(kind: MarkingKind, rng: np.random.Generator) -> Section:
    """A random section of a road of this kind."""
    line = partial(_line, rng)
    solid, dashed = line(), line(Stroke.DASHED)
    shoulder_m = float(rng.uniform(0.1, 0.9))
    lane, far = NeighbourLane(marking=line(Stroke.DASHED)), NeighbourLane(marking=line())
    two_lanes = {"left_lanes": (far,), "right": solid, "paved_right_m": shoulder_m}
    look: dict[str, object]
    match kind:
        case MarkingKind.WHITE:
            look = {**two_lanes, "left": dashed}
        case MarkingKind.YELLOW:
            look = {**two_lanes, "left": line(paint=Paint.YELLOW)}
        case MarkingKind.DOUBLE:
            look = {**two_lanes, "left": line(Stroke.DOUBLE_SOLID, paint=Paint.YELLOW)}
        case MarkingKind.DASHED:
            look = {"left": dashed, "right": line(Stroke.DASHED), "left_lanes": (far,), "right_lanes": (far,)}
        case MarkingKind.ONE_LINE:
            bare = (NeighbourLane(marking=NONE),)
            look = {"left": NONE, "right": solid, "left_lanes": bare, "paved_right_m": shoulder_m}
            if rng.random() < 0.5:
                look = {"left": solid, "right": NONE, "right_lanes": bare}
        case MarkingKind.WORN:
            wear = rng.uniform(0.4, 0.7, 2).tolist()
            lines = {"left": line(Stroke.DASHED, wear=wear[0]), "right": line(wear=wear[1])}
            look = {**two_lanes, **lines, "patchiness": 0.8}
        case MarkingKind.CONCRETE:
            grey = float(rng.uniform(0.52, 0.66))
            look = {**two_lanes, "left": dashed, "surface": Surface.CONCRETE, "surface_grey": grey}
        case MarkingKind.INTERRUPTED:
            look = {**two_lanes, "left": line(gaps_m=_gaps(rng)), "right": line(gaps_m=_gaps(rng))}
        case MarkingKind.MULTI_LANE:
            look = {"left": dashed, "right": line(Stroke.DASHED), "paved_right_m": 2.5}
            look |= {"left_lanes": (lane, far), "right_lanes": (far,)}
        case _:
            look = _unmarked_fields(kind, rng)
    return Section.model_validate(_ordinary(rng) | look | {"name": kind.value, "start_m": 0.0})


def snow_on(cover: float) -> dict[str, object]:
    """Fields of a section under trodden snow, on this share of the carriageway and along its edges."""
    return {"verge": Verge.SNOW, "snow_cover": cover, "snow_left_m": 0.3, "snow_right_m": 0.3}


def _line(rng: np.random.Generator, stroke: Stroke = Stroke.SOLID, **fields: object) -> Marking:
    dash_m, gap_m = DASHES_M[int(rng.integers(5))]
    width_m, wear = float(rng.uniform(0.10, 0.16)), float(rng.uniform(0, 0.25))
    drawn = {"stroke": stroke, "width_m": width_m, "dash_m": dash_m, "gap_m": gap_m, "wear": wear}
    return Marking.model_validate(drawn | fields)


def _gaps(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Gaps of 6 to 15 m, one about every 25 m."""
    starts = np.arange(5.0, 250.0, 25.0) + rng.uniform(0, 8, 10)
    ends = starts + rng.uniform(6, 15, 10)
    return tuple(zip(starts.tolist(), ends.tolist(), strict=True))


def _ordinary(rng: np.random.Generator) -> dict[str, object]:
    return {
        "surface_grey": float(rng.uniform(0.28, 0.52)),
        "patchiness": float(rng.uniform(0, 0.5)),
        "verge": VERGES[int(rng.choice(4, p=VERGE_SHARES))],
    }


def _unmarked_fields(kind: MarkingKind, rng: np.random.Generator) -> dict[str, object]:
    """A carriageway without markings, which is the lane."""
    look: dict[str, object] = {"left": NONE, "right": NONE, "paved_left_m": 0.0, "paved_right_m": 0.0}
    match kind:
        case MarkingKind.ASPHALT:
            look |= {"edge_roughness_m": 0.04}
        case MarkingKind.BROKEN:
            look |= {"edge_breaks": float(rng.uniform(0.2, 0.5)), "edge_roughness_m": 0.08, "patchiness": 1.0}
        case _:
            grey = float(rng.uniform(0.48, 0.6))
            look |= {"surface": Surface.GRAVEL, "surface_grey": grey, "edge_roughness_m": 0.1}
    other = Verge.SOIL if kind == MarkingKind.BROKEN else Verge.DRY_GRASS
    return look | {"verge": str(rng.choice([Verge.GRASS, other]))}
