"""A level camera over a straight lane, and a car driven along it by a steering rule."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from perception.techniques.steering.rule import ImageLine, LevelPicture

HEIGHT_M, FOCAL_PX, WIDTH_M, WHEELBASE_M = 1.2, 320.0, 3.5, 2.7
PICTURE = LevelPicture(640.0, 480.0, FOCAL_PX, 320.0, 240.0, HEIGHT_M)


def line(lateral_m: float, offset_m: float, heading_rad: float) -> ImageLine:
    """The image of a boundary at ``lateral_m`` (+ left of the lane centre), by projecting two points of it."""
    points = []
    for along in (15.0, 60.0):
        ahead = along * math.cos(heading_rad) + (lateral_m - offset_m) * math.sin(heading_rad)
        aside = -along * math.sin(heading_rad) + (lateral_m - offset_m) * math.cos(heading_rad)
        points.append(
            (PICTURE.centre_x_px - FOCAL_PX * aside / ahead, PICTURE.horizon_px + FOCAL_PX * HEIGHT_M / ahead)
        )
    (x0, y0), (x1, y1) = points
    m = (x1 - x0) / (y1 - y0)
    return ImageLine(m, x0 - m * y0)


def pair(offset_m: float, heading_rad: float, width_m: float = WIDTH_M) -> tuple[ImageLine, ImageLine]:
    """Left and right boundary of a lane in the picture."""
    return line(width_m / 2, offset_m, heading_rad), line(-width_m / 2, offset_m, heading_rad)


@dataclass(frozen=True)
class Drive:
    """The result of a drive."""

    offsets_m: tuple[float, ...]
    left_lane: bool

    @property
    def final_m(self) -> float:
        """Greatest distance from the centre in the last five seconds."""
        return max(abs(e) for e in self.offsets_m[-100:])


def drive(
    steer: Callable[[float, float], float],
    *,
    speed_mps: float,
    delay_s: float,
    duration_s: float = 40.0,
    offset_m: float = 0.5,
) -> Drive:
    """A kinematic car from ``offset_m`` on a straight road: ``steer(e, ψ)`` at 20 Hz gives the road-wheel angle.

    The lane is left when the car's reference point is over a boundary, or when its heading exceeds 0.8 rad.
    """
    e, psi, offsets = offset_m, 0.0, []
    waiting = deque([0.0] * round(delay_s * 20))
    for _ in range(round(duration_s * 20)):
        waiting.append(steer(e, psi))
        turn = speed_mps * math.tan(waiting.popleft()) / WHEELBASE_M
        for _ in range(5):
            e, psi = e + speed_mps * math.sin(psi + turn * 0.005) * 0.01, psi + turn * 0.01
        offsets.append(e)
        if abs(e) > WIDTH_M / 2 or abs(psi) > 0.8:
            return Drive(tuple(offsets), True)
    return Drive(tuple(offsets), False)
