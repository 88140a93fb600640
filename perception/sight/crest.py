"""A crest: the ground ends below the horizon of the camera, and stays there while the car drives on.

In every frame the lowest row is looked for in which the light steps on the road and on both sides of it, in any
colour, since grass may be as light as the hills beyond it: the end of the ground. On a flat road it is the horizon.
The dip of the row below the horizon is that of flat ground at the distance D. Paint, shadows and joints across the
road step as well, but they approach by the way s that the car drives: ρ = -dD/ds is 1. At a crest of radius R that
begins x₀ ahead, the ray that touches it h below the lens does so at

    x = √(x₀² + 2·R·h),    D = (x + x₀)/2,    ρ = (1 + x₀/x)/2

so that ρ falls from 1 to ½ as the car comes near, and is 0 on the crest, where x₀ = 0. With x₀ eliminated,

    x = D / max(ρ, ½)

is the sight. Far away a row is too coarse to give ρ in a second of driving: what is measured is weighed with the
ρ that is usual before a crest. Where only l metres of the arc remain and the road falls evenly behind it, all of
it is seen as soon as l < √(2·R·h). The row is then that of its vanishing point, D = h·R/l grows with the way, and
ρ ≤ -½: no crest. Neither is an edge beyond which road and verges look as before it.
"""

import math
from collections import deque
from typing import NamedTuple

import cv2
import numpy as np

from perception.sight.settings import CrestSettings
from perception.sight.strip import Path
from trepid.car.camera import Camera
from trepid.types import Array, Image

BESIDE_M, ROAD_M = (
    (4.5, 14.0),
    1.2,
)  # ground beside the lane, to each side, and half of the ground of the lane
LEAST_PX = 6  # columns of a part
DARKEST = 0.002  # linear light: a tenth of the grey scale
LOG_LIGHT = np.log(np.maximum((np.arange(256) / 255) ** 2, DARKEST)).astype(np.float32)
BEFORE_PX = 8  # rows before an edge that show the ground there
EDGE_PX = 3  # rows over which the steps of one edge are spread
ABOVE_PX, STEPS_PX = 3, 2  # rows above the horizon that are looked at; rows on each side of a step
TEXTURE_PX = (
    26  # rows below the horizon from which on steps are the texture of the ground, at 190 px focal length
)
STANDING_MPS = 0.2  # below, the way is that of the noise of the speed
NEWEST_S = 0.2  # age of the newest end of the ground that still counts
SIGMA_OF_MEDIAN = 1.48  # standard deviation over the median size of normal numbers


class End(NamedTuple):
    """The end of the ground in one frame."""

    t_s: float
    way_m: float  # driven so far
    ahead_m: float  # distance from the lens at which flat ground has the row of the end


class GroundEnd:
    """Looks for the end of the ground with one camera."""

    def __init__(self, camera: Camera, settings: CrestSettings) -> None:
        self._camera, self._settings = camera, settings
        horizon, scale = camera.horizon_row_px, camera.fy_px / 190.0
        first = max(math.floor(horizon) - ABOVE_PX, 0)
        last = min(math.floor(horizon + 70 * scale), camera.height_px)
        self._rows = np.arange(first, last)
        self._drop_px = self._rows - horizon
        self._is_texture = self._drop_px > TEXTURE_PX * scale
        # Near the horizon flat ground is far away; the row there shows what is 1.5 px below it.
        below = np.arctan((np.maximum(self._rows, horizon + 1.5) - camera.cy_px) / camera.fy_px)
        self._ahead_m = camera.height_m / np.tan(camera.pitch_down_rad + below)
        per_m = camera.fx_px / self._ahead_m
        sides = ((-BESIDE_M[1], -BESIDE_M[0]), (-ROAD_M, ROAD_M), BESIDE_M)
        self._left_px = np.array([low * per_m for low, _ in sides])
        self._right_px = np.array([high * per_m for _, high in sides])

    @property
    def is_usable(self) -> bool:
        """Whether the image shows ground from the horizon on."""
        return bool(self._is_texture.sum() > 8 and self._drop_px[0] < 0)

    def ahead_m(self, image: Image, path: Path) -> float | None:
        """Distance [m] from the lens of flat ground in the row where the ground ends; None: at the horizon."""
        if not self.is_usable:
            return None
        settings, camera = self._settings, self._camera
        light = self._light(image, path)
        steps = np.full(light.shape, np.nan)
        steps[..., STEPS_PX:-STEPS_PX] = (
            light[..., :-4] + light[..., 1:-3] - light[..., 3:-1] - light[..., 4:]
        ) / 2
        size = np.abs(steps)
        texture = size[..., self._drop_px > EDGE_PX]
        known = ~np.isnan(texture)
        if not known.any(axis=-1).all():
            return None
        ranked, middle = np.sort(texture, axis=-1), known.sum(axis=-1, keepdims=True) // 2  # NaN are last
        usual = SIGMA_OF_MEDIAN * np.take_along_axis(ranked, middle, axis=-1)
        clear = np.nan_to_num(size / np.maximum(settings.step_sigmas * usual, settings.least_step)).max(
            axis=0
        )
        found = np.flatnonzero((clear >= 1.0).all(axis=0) & ~self._is_texture)
        if len(found) == 0:
            return None
        rows = found[found > found[-1] - EDGE_PX]  # of the lowest edge; trees and sky step above it
        if self._goes_on(light, int(rows[0]), int(rows[-1])):
            return None
        weight = clear[:, rows].mean(axis=0)
        drop_px = float(weight @ self._drop_px[rows] / weight.sum())
        below = math.atan((camera.horizon_row_px + drop_px - camera.cy_px) / camera.fy_px)
        dip_rad = camera.pitch_down_rad + below
        return camera.height_m / math.tan(dip_rad) if dip_rad >= settings.least_dip_rad else None

    def _goes_on(self, light: Array, first: int, last: int) -> bool:
        """Whether ground and road look beyond an edge, between these rows, as they do before it.

        So they do beyond a shadow or a crossing road.
        """
        before = np.median(light[..., last + STEPS_PX + 1 : last + STEPS_PX + 1 + BEFORE_PX], axis=-1)
        beyond = light[..., (self._drop_px > 1) & (np.arange(len(self._rows)) < first - STEPS_PX)]
        alike = np.abs(beyond - before[..., None]) < self._settings.least_step
        return bool(alike.all(axis=(0, 1)).any())

    def _light(self, image: Image, path: Path) -> Array:
        """Mean logarithm of the light left of the lane, on it and right of it, in every channel.

        Shape (channels, 3, rows); NaN: not in the image.
        """
        rows = np.asarray(cv2.LUT(image[self._rows[0] : self._rows[-1] + 1], LOG_LIGHT), np.float32)
        rows = rows.reshape(*rows.shape[:2], -1)
        sums = np.atleast_3d(cv2.integral(rows, sdepth=cv2.CV_64F))
        columns = np.nan_to_num(path.column_at(self._ahead_m + self._camera.x_m), nan=self._camera.cx_px)
        left, right = columns + self._left_px, columns + self._right_px
        short = np.maximum(LEAST_PX - (right - left), 0.0) / 2
        width = image.shape[1]
        first = np.clip(np.floor(left - short), 0, width).astype(int)
        last = np.clip(np.floor(right + short), 0, width).astype(int)
        count = (last - first)[..., None]
        at = np.arange(len(self._rows))
        inside = sums[at + 1, last] - sums[at, last] - sums[at + 1, first] + sums[at, first]
        means = inside / np.maximum(count, 1)
        return np.moveaxis(np.where(count >= LEAST_PX // 2, means, np.nan), -1, 0)


class CrestFinder:
    """Tells a crest from what lies on the ground, over the last moments of a drive."""

    def __init__(self, settings: CrestSettings, height_m: float) -> None:
        """``height_m``: of the lens above the ground."""
        self._settings, self._height_m = settings, height_m
        self._ends: deque[End] = deque()
        self._frames: deque[float] = deque()  # times of all frames looked at
        self._way_m, self._t_s = 0.0, -math.inf
        self._found_m, self._found_s = math.inf, -math.inf  # the last sight that was found

    def step(self, ahead_m: float | None, speed_mps: float | None, t_s: float) -> float | None:
        """Sight [m] from the lens up to a crest; None without one.

        ``ahead_m``: the end of the ground in the frame of ``t_s``, as of :meth:`GroundEnd.ahead_m`. A crest that is
        no longer found counts for ``memory_s`` of driving: the ground does not change, trees behind it do. Without
        a known speed the result is None, and the frames before no longer count.
        """
        settings, dt_s = self._settings, t_s - self._t_s
        self._t_s = t_s
        if speed_mps is None or not math.isfinite(speed_mps) or not 0.0 <= dt_s <= settings.memory_s:
            self._ends.clear()
            self._frames.clear()
            self._found_s = -math.inf
            return None
        found_m = self._find(ahead_m, speed_mps * dt_s, t_s)
        if found_m is not None:
            self._found_m, self._found_s = found_m, t_s
        elif abs(speed_mps) < STANDING_MPS:
            self._found_s += dt_s
        return self._found_m if t_s - self._found_s <= settings.memory_s else None

    def _find(self, ahead_m: float | None, gone_m: float, t_s: float) -> float | None:
        """The sight by the ends of the ground up to now; ``gone_m``: driven since the frame before."""
        settings = self._settings
        self._way_m += gone_m
        self._frames.append(t_s)
        if ahead_m is not None:
            self._ends.append(End(t_s, self._way_m, ahead_m))
        while self._frames[0] < t_s - settings.memory_s:
            self._frames.popleft()
        while self._ends and self._ends[0].t_s < t_s - settings.memory_s:
            self._ends.popleft()
        if t_s - self._frames[0] < settings.memory_s / 2 or not self._ends:
            return None
        newest = self._ends[-1]
        if t_s - newest.t_s > NEWEST_S:
            return None
        if len(self._ends) < settings.seen_share * len(self._frames):
            return None
        closing = self._closing()
        return None if closing is None else newest.ahead_m / min(max(closing, 0.5), 1.0)

    def _closing(self) -> float | None:
        """ρ, where it is rather that of a crest than that of ground; None elsewhere.

        It is the mean of what was measured and what is usual before a crest, by their weights.

        Theil-Sen's slope (Sen, JASA 63, 1968) between the older and the newer half: single wrong rows do not count.
        """
        half = len(self._ends) // 2
        ends = list(self._ends)
        pairs = [(a, b) for a, b in zip(ends[:half], ends[-half:], strict=True) if b.way_m - a.way_m > 0.0]
        if not pairs:
            return None
        way_m = float(np.median([b.way_m - a.way_m for a, b in pairs]))
        nearer = np.array([(a.ahead_m - b.ahead_m) / (b.way_m - a.way_m) for a, b in pairs])
        closing = float(np.median(nearer))
        usual_m = float(np.median([end.ahead_m for end in ends]))
        apart_m = self._settings.row_sigma_rad * usual_m**2 / self._height_m  # dD = D²/h·dα
        settings = self._settings
        if not settings.least_closing <= closing < settings.most_closing:
            return None
        weight = settings.closing_sigma**2 / (settings.closing_sigma**2 + (apart_m / way_m) ** 2)
        return settings.usual_closing + weight * (closing - settings.usual_closing)
