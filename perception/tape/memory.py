"""Lines that have left the image, moved with the vehicle by its speed and yaw rate."""

import numpy as np

from perception.tape.floor import NO_POINTS, FloorRaster, TapePoints
from perception.tape.settings import MemorySettings
from trepid.clothoid import chord

THIN_M = 0.15  # one point is kept of those in a square of this side


class LineMemory:
    """Points of earlier frames, each once, where the present image does not show the floor."""

    def __init__(self, settings: MemorySettings) -> None:
        self._settings = settings
        self.points = NO_POINTS

    def forget(self) -> None:
        """Remember nothing."""
        self.points = NO_POINTS

    def move(self, way_m: float, turned_rad: float) -> None:
        """Into the frame of the vehicle after an arc of ``way_m`` that turned by ``turned_rad``."""
        points, settings = self.points, self._settings
        along_m, aside_m = chord(way_m, turned_rad)
        at = (points.x_m - along_m + 1j * (points.y_m - aside_m)) * np.exp(-1j * turned_rad)
        moved = TapePoints(
            at.real,
            at.imag,
            points.course_rad - turned_rad,
            points.contrast,
            points.line_m,
            points.way_m + abs(way_m),
        )
        kept = (moved.way_m < settings.keep_m) & (moved.x_m > -settings.behind_m)
        self.points = moved.where(kept)

    def update(self, seen: TapePoints, raster: FloorRaster) -> TapePoints:
        """``seen`` in place of what was remembered where ``raster`` shows the floor; all of it is returned."""
        old = self.points.where(~raster.sees(self.points.x_m, self.points.y_m, self.points.line_m))
        old = old.where(np.arange(len(old.x_m)) >= len(old.x_m) - self._settings.most_points)
        self.points = old.plus(thin(seen))
        return self.points


def thin(points: TapePoints) -> TapePoints:
    """One point, the first, of those in each square of ``THIN_M``."""
    if not len(points.x_m):
        return points
    cells = np.rint(np.column_stack([points.x_m, points.y_m]) / THIN_M).astype(int)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = np.zeros(len(points.x_m), bool)
    kept[first] = True
    return points.where(kept)
