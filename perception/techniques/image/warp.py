"""Warped pictures of the same road: smaller, or from above (inventory A05, A23, A24)."""

import math
from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from perception.techniques.image.colour import grey
from perception.techniques.image.picture import GroundView
from trepid.types import Array, Image, Positive, PositiveShare

EDGE_PX = 3  # reach of the filters at the border of the picture
MIN_SEGMENT_PX = 12.0  # shorter segments have no reliable direction
SLANTED = 0.15  # sine of the least slope to the rows
MIN_SEGMENTS = 4
FIT_ROUNDS = 8


def area_resize(image: Image, view: GroundView, *, scale: PositiveShare = 0.5) -> tuple[Image, GroundView]:
    """The picture scaled down by averaging areas, which keeps its mean grey (A05, A21). Source: R [13]; D 4.1."""
    size = (max(16, round(view.width_px * scale)), max(16, round(view.height_px * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8), view.resize(*size)


def bird_eye(
    image: Image,
    view: GroundView,
    *,
    reach_m: Positive = 30.0,
    half_width_m: Positive = 8.0,
    pixel_m: Positive = 0.08,
) -> tuple[Image, GroundView]:
    """The road from above, by inverse perspective mapping with the known camera (A23).

    x' ~ H·x with H from K, pitch and height. Pixels outside of the camera image are filled from its border and
    give no features. Source: R II.A.2 [31]–[41]. Limit: hills and pitching; vehicles, which become long smears.
    """
    above = view_from_above(view, reach_m=reach_m, half_width_m=half_width_m, pixel_m=pixel_m)
    source_from_above = view.pixel_from_ground @ above.ground_from_pixel
    size = (above.width_px, above.height_px)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(image, source_from_above, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    whole = np.zeros((view.height_px, view.width_px), np.uint8)
    whole[EDGE_PX:-EDGE_PX, EDGE_PX:-EDGE_PX] = 1
    seen = cv2.warpPerspective(whole, source_from_above, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    return np.asarray(warped, np.uint8), replace(above, seen=seen > 0)


def view_from_above(view: GroundView, *, reach_m: float, half_width_m: float, pixel_m: float) -> GroundView:
    """From the nearest road in the middle of ``view`` to ``reach_m``; the top row is the farthest."""
    reach_m = max(reach_m, view.nearest_m + 16 * pixel_m)
    x_m, y_m = reach_m - pixel_m / 2, half_width_m - pixel_m / 2  # road at the centre of pixel (0, 0)
    matrix = np.array([[0, -1 / pixel_m, y_m / pixel_m], [-1 / pixel_m, 0, x_m / pixel_m], [0, 0, 1.0]])
    size = (round(2 * half_width_m / pixel_m), round((reach_m - view.nearest_m) / pixel_m))
    return GroundView(view.camera, *size, matrix, from_above=True)


class BirdEyeSelf:
    """The road from above, with the pitch estimated from the picture (A24).

    Source: R [39]. Limit: lines that are not of the road; with few lines the pitch is kept.
    """

    def __init__(
        self,
        *,
        reach_m: Positive = 30.0,
        half_width_m: Positive = 8.0,
        pixel_m: Positive = 0.08,
        memory: Annotated[float, Field(ge=0, lt=1)] = 0.8,
        most_rad: Annotated[float, Field(gt=0, lt=0.3)] = 0.06,
    ) -> None:
        """``memory``: share of the old pitch; ``most_rad``: greatest change from the pitch of the camera file."""
        self._size = {"reach_m": reach_m, "half_width_m": half_width_m, "pixel_m": pixel_m}
        self._memory, self._most_rad = memory, most_rad
        self._change_rad: float | None = None

    def step(self, image: Image, view: GroundView) -> tuple[Image, GroundView]:
        """As :func:`bird_eye`, after :func:`pitch_view` by the smoothed change of pitch."""
        change = pitch_change_rad(image, view)
        if change is not None and abs(change) <= self._most_rad:
            old = change if self._change_rad is None else self._change_rad
            self._change_rad = self._memory * old + (1 - self._memory) * change
        return bird_eye(image, pitch_view(view, self._change_rad or 0.0), **self._size)


def pitch_view(view: GroundView, change_rad: float) -> GroundView:
    """The view with the camera turned down by ``change_rad`` more."""
    camera = view.camera.model_copy(update=dict(pitch_down_rad=view.camera.pitch_down_rad + change_rad))
    picture_from_image = view.pixel_from_ground @ np.linalg.inv(view.camera.pixel_from_road_matrix)
    return replace(view, camera=camera, pixel_from_ground=picture_from_image @ camera.pixel_from_road_matrix)


def pitch_change_rad(image: Image, view: GroundView) -> float | None:
    """Pitch of the camera [rad, + down] minus that of its file; None when it cannot be measured.

    The lines of the road meet at the horizon, v = cy − f·tan(pitch), so Δ = pitch(v found) − pitch(v assumed).
    """
    ends = road_segments_px(grey(image, view), view)
    point = meeting_point(ends, np.array([(view.width_px - 1) / 2, view.horizon_px]))
    if point is None:
        return None
    image_from_picture = view.camera.pixel_from_road_matrix @ view.ground_from_pixel
    _, v, w = image_from_picture @ [*point, 1.0]
    camera = view.camera
    return math.atan((camera.cy_px - v / w) / camera.fy_px) - camera.pitch_down_rad


def road_segments_px(grey_image: Image, view: GroundView) -> Array:
    """Ends, shape (n, 2, 2), of the slanted line segments below the horizon.

    Grompone von Gioi et al., LSD: a Line Segment Detector, IPOL 2012.
    """
    found = cv2.createLineSegmentDetector().detect(grey_image)[0]
    if found is None:
        return np.empty((0, 2, 2))
    ends = np.asarray(found, float).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    slanted = (np.abs(along[:, 1]) > SLANTED * length) & (length > MIN_SEGMENT_PX)
    return ends[slanted & (ends[:, :, 1].max(axis=1) > view.horizon_px + MIN_SEGMENT_PX)]


def meeting_point(ends: Array, start: Array, *, scale_px: float = 3.0) -> Array | None:
    """The point (x, y) near ``start`` on most of the lines through ``ends``; None with too few lines.

    Least squares of the distances n·(p − a), each weighted by the length of its segment and by Cauchy's
    1/(1 + (r/s)²), with s falling from 8 to 1 times ``scale_px``.
    """
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(length, 1e-9)[:, None]
    offset = np.einsum("ij,ij->i", normal, ends[:, 0])
    point = np.asarray(start, float)
    for scale in scale_px * np.geomspace(8, 1, FIT_ROUNDS):
        weight = length / (1 + ((normal @ point - offset) / scale) ** 2)
        matrix = (normal * weight[:, None]).T @ normal
        if np.linalg.cond(matrix) > 1e3:
            return None  # all in one direction
        point = np.linalg.solve(matrix, (normal * weight[:, None]).T @ offset)
    agreed = np.abs(normal @ point - offset) < scale_px
    return point if np.count_nonzero(agreed) >= MIN_SEGMENTS else None
