"""Edges that ants link (inventory B28)."""

from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.techniques.image.colour import grey
from perception.techniques.image.picture import FeatureKind, Features, GroundView
from trepid.types import Array, Image, Positive, PositiveShare

STROKE = 255
AROUND = np.array([(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)])  # rows, columns
SIDE_BY_SIDE = 5  # squared length of the sum of two steps of AROUND that are neighbours
FLAT = 1.0  # Sobel grey levels that every pixel has: an ant can cross a flat one
MOST_ENDS = 300  # of edges, evenly over the picture
Places = NDArray[np.intp]
"""(n, 2) rows and columns."""


class AntGround(NamedTuple):
    """What the ants walk on."""

    slope: Array  # |∂x| + |∂y| [Sobel grey levels], + FLAT
    pieces: NDArray[np.int32]  # number of the edge of a pixel; 0: none
    pheromone: Array


def canny_ants(
    image: Image,
    view: GroundView,
    *,
    low: Positive = 50.0,
    high: Positive = 150.0,
    reach_px: Annotated[int, Field(ge=1, le=60)] = 12,
    ants: Annotated[int, Field(ge=1, le=50)] = 4,
    rounds: Annotated[int, Field(ge=1, le=20)] = 3,
    evaporation: PositiveShare = 0.3,
    least_slope: Positive = 12.0,
) -> Features:
    """Canny's edges, and the ways on which ants found from the end of one edge to another within ``reach_px``.

    An ant goes ahead, to a neighbour j within a right angle of its last step, with probability ∝ τ(j)·η(j)², where
    η = |∂x| + |∂y| and τ is the pheromone, 1 at first. The ways of ants that reach an edge gain η/max η of their
    mean slope; all pheromone evaporates by ``evaporation`` a round. The way of the greatest mean slope from an end
    joins the edges, if it is above ``least_slope`` [Sobel grey levels]. The draws are the same for every picture.

    Source: R [79], which prints no equation; Dorigo, Maniezzo and Colorni, Ant System (1996). Limit: shadows and
    cracks between paint; an edge that turns aside at its end; many times the time of Canny.
    """
    plain = grey(image, view)
    dx, dy = (cv2.Sobel(plain, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    edges = np.asarray(cv2.Canny(image, low, high), np.uint8)
    _, pieces = cv2.connectedComponents(edges, connectivity=8)
    ground = AntGround(np.abs(dx) + np.abs(dy) + FLAT, np.asarray(pieces, np.int32), np.ones(edges.shape))
    starts, headings = _ends(edges > 0)
    linked = edges.copy()
    if len(starts):
        rng = np.random.default_rng(0)
        best: dict[int, tuple[float, Places]] = {}  # of an end: mean slope, way
        for _ in range(rounds):
            for _ in range(ants):
                ways, lengths = _walk(ground, starts, headings, reach_px, rng)
                for end in np.nonzero(lengths)[0].tolist():
                    way = ways[end, : lengths[end]]
                    mean = float(ground.slope[way[:, 0], way[:, 1]].mean())
                    if mean > best.get(end, (least_slope, way))[0]:
                        best[end] = mean, way
                    ground.pheromone[way[:, 0], way[:, 1]] += mean / float(ground.slope.max())
            ground.pheromone[:] *= 1.0 - evaporation
        for _, way in best.values():
            linked[way[:, 0], way[:, 1]] = STROKE
    return Features(linked, FeatureKind.LINE)


def _ends(edges: NDArray[np.bool_]) -> tuple[Places, Places]:
    """Pixels whose neighbours are one, or two side by side; and the step from them to the pixel."""
    inner = np.pad(edges, 1)
    height, width = edges.shape
    near = np.stack([inner[1 + r : 1 + r + height, 1 + c : 1 + c + width] for r, c in AROUND], axis=-1)
    count, sums = near.sum(axis=-1), near @ AROUND
    beside = (sums**2).sum(axis=-1) == SIDE_BY_SIDE
    places = np.argwhere(edges & ((count == 1) | ((count == 2) & beside)))
    if len(places) > MOST_ENDS:
        places = places[np.linspace(0, len(places) - 1, MOST_ENDS).astype(int)]
    rows, columns = places.T
    return places, -np.round(sums[rows, columns] / count[rows, columns, None]).astype(np.intp)


def _walk(
    ground: AntGround, starts: Places, headings: Places, reach_px: int, rng: np.random.Generator
) -> tuple[Places, NDArray[np.intp]]:
    """The steps (n, reach, 2) of all ants, and the number of those before an edge; 0 where none was reached."""
    edge = np.array(ground.pieces.shape) - 1
    home = ground.pieces[tuple(starts.T)]
    at, heading = starts, headings
    ways = np.zeros((len(starts), reach_px, 2), np.intp)
    lengths, walking = np.zeros(len(starts), np.intp), np.ones(len(starts), bool)
    for step in range(reach_px):
        beside = at[:, None] + AROUND  # (n, 8, 2)
        inside = ((beside >= 0) & (beside <= edge)).all(axis=2)
        beside = np.clip(beside, 0, edge)
        rows, columns = beside[..., 0], beside[..., 1]
        weight = np.log(ground.pheromone[rows, columns]) + 2.0 * np.log(ground.slope[rows, columns])
        ahead = (AROUND * heading[:, None]).sum(axis=2) > 0
        own = ground.pieces[rows, columns] == home[:, None]
        drawn = np.where(inside & ahead & ~own, weight + rng.gumbel(size=weight.shape), -np.inf)
        chosen = drawn.argmax(axis=1)
        walking &= np.isfinite(drawn.max(axis=1))
        each = np.arange(len(at))
        at, heading = np.where(walking[:, None], beside[each, chosen], at), AROUND[chosen]
        ways[:, step] = at
        there = walking & (ground.pieces[tuple(at.T)] > 0)
        lengths[there] = step
        walking &= ~there
    return ways, lengths
