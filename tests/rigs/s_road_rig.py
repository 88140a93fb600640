"""Open roads from pieces, and an S whose bends take a given lateral acceleration at one speed."""

from collections.abc import Sequence
from functools import cache

from sim_harness.world.roads.road import Road, RoadSettings, Segment

LINE = {"stroke": "solid"}


def road(pieces: Sequence[tuple[float, float | tuple[float, float]]]) -> Road:
    """Open road of (length [m], curvature [1/m], or those of its ends) pieces, 3.5 m wide, with solid lines."""
    section = {"name": "all", "start_m": 0.0, "left": LINE, "right": LINE}
    segments = tuple(Segment(length_m=length_m, curvature_1pm=bend_1pm) for length_m, bend_1pm in pieces)
    fields = {
        "name": "pieces",
        "closed": False,
        "lane_width_m": 3.5,
        "segments": segments,
        "sections": (section,),
    }
    return Road(RoadSettings.model_validate(fields))


@cache
def s_clothoid(speed_mps: float) -> Road:
    """Two arcs, left and right, 2 s each at 2 m/s², with entries and exits at 1 m/s³."""
    entry = 2.0 * speed_mps, 2.0 / speed_mps**2
    left = [(entry[0], (0.0, entry[1])), entry, (entry[0], (entry[1], 0.0))]
    right = [(entry[0], (0.0, -entry[1])), (entry[0], -entry[1]), (entry[0], (-entry[1], 0.0))]
    return road([(speed_mps, 0.0), *left, *right, (speed_mps, 0.0)])
