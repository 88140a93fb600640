"""A straight road in a plan view, for tests of the painters of the ground."""

from dataclasses import dataclass

import cv2
import numpy as np

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.roads.appearance import Marking, Section, Stroke
from sim_harness.world.roads.road import Road, RoadSettings, Segment

NONE = Marking(stroke=Stroke.NONE)
WIDTH_M = 3.4
PIXEL_M = 0.025


def straight(*sections: Section, length_m: float = 100.0, **road) -> Road:
    """A straight road along x with these sections."""
    return Road(
        RoadSettings(
            **{"name": "straight", "closed": False, "lane_width_m": WIDTH_M}
            | {"segments": (Segment(length_m=length_m),), "sections": sections}
            | road
        )
    )


def bare(name: str = "bare", start_m: float = 0.0, **section) -> Section:
    """A section of plain dark asphalt with straight edges and without markings, with the given changes."""
    plain = {"left": NONE, "right": NONE, "patchiness": 0, "edge_roughness_m": 0, "surface_grey": 0.35}
    return Section(name=name, start_m=start_m, **plain | section)


@dataclass(frozen=True)
class Plan:
    """Image of the ground from ``from_m`` to ``to_m`` along the road and ``right_m`` to ``left_m`` across it."""

    bgr: np.ndarray  # (offset, station, 3)
    x_m: np.ndarray  # station of every column
    y_m: np.ndarray  # offset of every row

    def white(self) -> np.ndarray:
        return self.bgr.min(axis=2) > 160

    def yellow(self) -> np.ndarray:
        return (self.bgr[:, :, 2] > 170) & (self.bgr[:, :, 0] < 130)

    def dark(self) -> np.ndarray:
        """Carriageway in the middle of snow, without specks."""
        return cv2.medianBlur(self.bgr, 5).max(axis=2) < 140

    def row(self, offset_m: float) -> int:
        return int(np.argmin(np.abs(self.y_m - offset_m)))

    def column(self, station_m: float) -> int:
        return int(np.argmin(np.abs(self.x_m - station_m)))


def plan(
    road: Road, from_m: float = 0, to_m: float = 40, right_m: float = -4, left_m: float = 7, seed: int = 0
) -> Plan:
    """The ground of a straight road, painted at the finest level."""
    image, x0, y0 = Ground(road, seed=seed).crop(0, np.array([from_m, right_m]), np.array([to_m, left_m]))
    rows, columns = image.shape[:2]
    return Plan(image[:, :, :3], x0 + PIXEL_M * np.arange(columns), y0 + PIXEL_M * np.arange(rows))


def centres_m(mask: np.ndarray, places_m: np.ndarray) -> list[float]:
    """Centres of the runs of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int)))
    return [float((places_m[a] + places_m[b - 1]) / 2) for a, b in edges.reshape(-1, 2)]


def lengths_m(mask: np.ndarray) -> list[float]:
    """Lengths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int)))
    return [float(b - a) * PIXEL_M for a, b in edges.reshape(-1, 2)]
