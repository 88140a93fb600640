"""From features to points on the road, and to the candidates for the left and the right boundary."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perception.techniques.image.picture import Boundaries, Boundary, Evidence
from trepid.types import Array, Mask

REACH_M = 35.0  # ahead of the rear axle: beyond it, a pixel of a 320 × 240 picture is longer than a dash
ASIDE_M = 7.0  # to either side: the ego lane and the next
SLICE_M, MOST = 0.5, 60  # greatest number of road points in each slice of the road
BIN_M = 0.15  # of the histogram across the road: the width of a line
BINS = round(2 * ASIDE_M / BIN_M) + 1
APART_M, ALIKE = 0.9, 1.5
SIDE_AT_M = 6.0  # where a line is left or right of the car: the nearest road of most cameras
LEAST = 8  # points of a boundary
COURSE_M, COURSE_MOST, COURSE_BIN_M = 22.0, 300, 0.3  # reach, points and bins of the search for the course
HEADINGS = np.linspace(-0.2, 0.2, 17)
BENDS = np.array([0.0, 0.003, 0.006, 0.01, 0.015, 0.021, 0.03, 0.045])
BENDS = np.concatenate([-BENDS[:0:-1], BENDS])
# prefers the straighter of two roads with equal evidence
PLAIN = (1 - 0.3 * np.abs(HEADINGS)[:, None] - 2.0 * np.abs(BENDS)).ravel()
CELL_M = 1.0  # support is counted in pieces of this length
STEP_M = 0.5  # between the points of a boundary


@dataclass(frozen=True)
class Points:
    """Points on the road, each array of shape (n,)."""

    x_m: Array
    y_m: Array

    def where(self, kept: Mask) -> "Points":
        """The points selected by the mask ``kept``."""
        return Points(self.x_m[kept], self.y_m[kept])

    def __len__(self) -> int:
        return len(self.x_m)


def road_points(evidence: Evidence) -> Points:
    """Road points of the pixels above a third of the greatest response, near to far.

    Each ``SLICE_M`` of road keeps at most ``MOST`` points, evenly spread: near pixels cover less road and would
    outvote the others. Regions must be outlined first.
    """
    response, view = evidence.features.response, evidence.view
    top = float(response.max(initial=0))
    rows, columns = np.nonzero(response > top / 3 if top > 0 else np.zeros((1, 1), bool))
    road = view.ground(np.column_stack([columns, rows]).astype(float)) if len(rows) else np.empty((0, 2))
    inside = (road[:, 0] > 0) & (road[:, 0] < REACH_M) & (np.abs(road[:, 1]) < ASIDE_M)  # NaN is outside
    road = road[inside]
    road = road[np.argsort(road[:, 0], kind="stable")]
    cell = np.floor(road[:, 0] / SLICE_M).astype(int)
    count = np.bincount(cell, minlength=1)
    rank = np.arange(len(cell)) - (np.cumsum(count) - count)[cell]
    share = np.minimum(1.0, MOST / np.maximum(count[cell], 1))
    kept = np.floor((rank + 1) * share) > np.floor(rank * share)
    return Points(road[kept, 0], road[kept, 1])


def by_side(
    points: Points, predicted: Boundaries | None, *, gate_m: float = 0.8, spread: float = 0.05
) -> tuple[Points | None, Points | None]:
    """The candidates for the left and for the right boundary; None: no place to begin with.

    Points within ``gate_m`` + ``spread``·x of the predicted boundary; without one, of the course of the road by
    :func:`course` through the nearest peak of the histogram across it on that side.
    """
    before = (predicted.left, predicted.right) if predicted is not None else (None, None)
    heading, bend = (0.0, 0.0) if None not in before else course(points)
    straight = Points(points.x_m, points.y_m - heading * points.x_m - bend * points.x_m**2 / 2)
    ahead = heading * SIDE_AT_M + bend * SIDE_AT_M**2 / 2
    peaks = histogram_peaks(straight)
    places = (
        min((peak for peak in peaks if peak + ahead > 0), default=None),
        max((peak for peak in peaks if peak + ahead <= 0), default=None),
    )
    gate = gate_m + spread * points.x_m
    return (
        _about(points, straight, before[0], places[0], gate),
        _about(points, straight, before[1], places[1], gate),
    )


def course(points: Points) -> tuple[float, float]:
    """Heading ψ [rad] and bend κ [1/m] of the road with the sharpest peaks of y − ψx − κx²/2.

    The histogram across the road (B29) is computed for every road of a grid, with Σ count² as its sharpness.
    Boundaries are parallel, so both vote for one road.
    """
    near = points.where(points.x_m < COURSE_M)
    if len(near) < 8:
        return 0.0, 0.0
    x_m, y_m = near.x_m[:: -(-len(near) // COURSE_MOST)], near.y_m[:: -(-len(near) // COURSE_MOST)]
    straight = y_m - HEADINGS[:, None, None] * x_m - BENDS[:, None] * x_m**2 / 2
    half_m = ASIDE_M + HEADINGS[-1] * COURSE_M + BENDS[-1] * COURSE_M**2 / 2
    bins = int(2 * half_m / COURSE_BIN_M) + 1
    place = ((straight + half_m) / COURSE_BIN_M).astype(np.int32).reshape(-1, len(x_m))
    roads = len(place)
    count = np.bincount((place + bins * np.arange(roads)[:, None]).ravel(), minlength=roads * bins)
    smooth = count.reshape(roads, bins).astype(float)
    smooth[:, 1:] += 0.5 * count.reshape(roads, bins)[:, :-1]
    smooth[:, :-1] += 0.5 * count.reshape(roads, bins)[:, 1:]
    sharpness = (smooth**2).sum(axis=1) * PLAIN
    heading, bend = np.unravel_index(int(np.argmax(sharpness)), (len(HEADINGS), len(BENDS)))
    return float(HEADINGS[heading]), float(BENDS[bend])


def histogram_peaks(points: Points, *, least: float = 0.25) -> list[float]:
    """Places y [m] of the peaks of the histogram across the road above ``least`` of the highest (B29).

    Each metre ahead counts once a bin, so that a long arrow counts as a dash of its length. Within ``APART_M``,
    the least distance of painted lines, much lower peaks are clutter of the highest.
    """
    near = points.where(points.x_m < COURSE_M)
    if not len(near):
        return []
    column = np.clip((near.y_m + ASIDE_M) / BIN_M, 0, BINS - 1).astype(int)
    cells = np.unique(column * 1000 + np.floor(near.x_m / CELL_M).astype(int)) // 1000
    count = np.bincount(cells, minlength=BINS).astype(float)
    count[[0, -1]] = 0.0  # points outside
    smooth = np.convolve(count, [0.5, 1.0, 0.5], mode="same")
    before, after = np.r_[0.0, smooth[:-1]], np.r_[smooth[1:], 0.0]
    top = (smooth > before) & (smooth >= after) & (smooth >= max(2.0, least * smooth.max()))
    peaks = [((i + 0.5) * BIN_M - ASIDE_M, smooth[i]) for i in np.flatnonzero(top)]
    return [
        float(place)
        for place, height in peaks
        if not any(abs(other - place) < APART_M and more > ALIKE * height for other, more in peaks)
    ]


def _about(
    points: Points, straight: Points, predicted: Boundary | None, place_m: float | None, gate_m: Array
) -> Points | None:
    if predicted is not None:
        a, b = np.polynomial.polynomial.polyfit(predicted.x_m[-4:], predicted.y_m[-4:], 1)
        centre = np.interp(points.x_m, predicted.x_m, predicted.y_m)
        centre = np.where(points.x_m > predicted.x_m[-1], a + b * points.x_m, centre)
        chosen = points.where(np.abs(points.y_m - centre) < gate_m)
    elif place_m is not None:
        chosen = points.where(np.abs(straight.y_m - place_m) < gate_m)
    else:
        return None
    return chosen if len(chosen) >= LEAST else None


def evenly(points: Points) -> Array:
    """Weights that count every piece of road alike, n^−½ for the n points of its ``SLICE_M``."""
    cell = np.floor(points.x_m / SLICE_M).astype(int)
    return 1 / np.sqrt(np.bincount(cell)[cell])


def support(x_m: Array, near_m: float, far_m: float) -> float:
    """Share of the metres from ``near_m`` to ``far_m`` with a point."""
    cells = max(1.0, (far_m - near_m) / CELL_M)
    return min(1.0, len(np.unique(np.floor(x_m / CELL_M))) / cells)


def rms(values: Array) -> float:
    """The root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def sample_curve(
    curve: Callable[[Array], Array], near_m: float, far_m: float, points: Points, residual_m: float = 0.0
) -> Boundary:
    """The boundary along y = ``curve(x)``, with the support of its ``points``."""
    x_m = np.linspace(near_m, far_m, max(3, round((far_m - near_m) / STEP_M)))
    return Boundary(x_m, np.asarray(curve(x_m), float), residual_m, support(points.x_m, near_m, far_m))


def each_side(evidence: Evidence, fitted: Callable[[Points], Boundary | None]) -> Boundaries:
    """The boundary that ``fitted`` returns for the candidates of each side."""
    sides = by_side(road_points(evidence), evidence.predicted)
    return both(*(None if points is None else fitted(points) for points in sides))


def both(left: Boundary | None, right: Boundary | None, *, kind: str = "line") -> Boundaries:
    """The pair with the reason for a missing side."""
    missing = [name for name, side in (("left", left), ("right", right)) if side is None]
    return Boundaries(left, right, f"no {' and no '.join(missing)} {kind}" if missing else "")
