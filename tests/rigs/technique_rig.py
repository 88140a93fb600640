"""Roads of known lane for the tests of the techniques: masks of paint and road, recall and precision."""

import cv2
import numpy as np
from drawn_road_rig import ASPHALT, CAMERA, WHITE, YELLOW, ribbon, road

from perception.techniques.image.picture import Boundaries, Boundary, camera_view
from perception.techniques.image.region import roi_fixed

__all__ = ["ASPHALT", "CAMERA", "LANE", "VIEW", "WHITE", "YELLOW", "ribbon", "road"]

VIEW = camera_view(CAMERA)
LANE = (0.2, 0.03, 0.0, 0.0)
BORDER_PX = 14  # paint at the border is cut
SKY_LIGHT = np.array([0.58, 0.50, 0.45])  # shares of blue, green and red in shadow


def paint(lane=LANE, width_m=3.4, reach_m=20.0, **how):
    """Pixels of paint up to ``reach_m``, away from the border: the difference to the road without lines."""
    marked = road(lane, width_m, **how).astype(int)
    bare = road(lane, width_m, left=None, right=None, **{k: v for k, v in how.items() if k == "seed"})
    mask = np.abs(marked - bare).max(axis=2) > 40
    mask[~(VIEW.ahead_m <= reach_m)] = False
    mask[:, :BORDER_PX] = mask[:, -BORDER_PX:] = False
    return mask


def grow(mask, pixels=2):
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * pixels + 1,) * 2, np.uint8)) > 0


def recall(response, truth):
    """Share of the rows of true paint with a response on it, per side of the picture."""
    found, total = 0, 0
    for half in (slice(0, CAMERA.width_px // 2), slice(CAMERA.width_px // 2, None)):
        rows = truth[:, half].any(axis=1)
        total += rows.sum()
        found += (rows & (grow(truth)[:, half] & (response[:, half] > 0)).any(axis=1)).sum()
    return found / total


def precision(response, truth, reach_m=20.0):
    """Share of the responses up to ``reach_m`` that lie on true paint."""
    near = np.where(np.isfinite(VIEW.ahead_m) & (VIEW.ahead_m <= reach_m), True, False)
    high = (response > 0) & near[:, None]
    return (high & grow(truth)).sum() / max(high.sum(), 1)


def f1(response, truth):
    r, p = recall(response, truth), precision(response, truth)
    return 2 * r * p / max(r + p, 1e-9)


def bars(image, *, from_m=8.0, to_m=10.0):
    """A shadow across the road."""
    shaded = image.astype(float)
    rows = (VIEW.ahead_m > from_m) & (VIEW.ahead_m < to_m)
    shaded[rows] *= SKY_LIGHT
    return shaded.round().astype(np.uint8)


def below_horizon(image):
    """The lower part of the picture and its view, as after roi_fixed."""
    box = roi_fixed(VIEW, None, None).box
    return np.ascontiguousarray(image[box.rows, box.columns]), VIEW.crop(box)


def straight_boundaries(offset_m=0.0, heading_rad=0.0, width_m=3.4, near_m=3.0, far_m=30.0):
    """The two straight boundaries of a lane."""
    x = np.linspace(near_m, far_m, 30)
    centre = -offset_m - np.tan(heading_rad) * x
    half = width_m / 2 / np.cos(heading_rad)
    return Boundaries(Boundary(x, centre + half, 0.02, 1.0), Boundary(x, centre - half, 0.02, 1.0))
