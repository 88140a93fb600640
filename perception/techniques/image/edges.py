"""Edges by gradients (inventory B03–B07, A16)."""

import cv2
import numpy as np

from perception.techniques.image.colour import grey
from perception.techniques.image.picture import FeatureKind, Features, GroundView
from perception.techniques.image.rows import upright_line
from perception.techniques.image.warp import road_segments_px
from trepid.types import Image, Positive

PREWITT = np.array([[-1, 0, 1]] * 3, np.float32) / 6
STROKE = 255


def canny(image: Image, view: GroundView, *, low: Positive = 50.0, high: Positive = 150.0) -> Features:
    """Edges of one pixel: gradient, non-maximum suppression, two thresholds [Sobel grey levels] (B03, B09).

    Source: R [43]–[51]; Canny, A Computational Approach to Edge Detection (1986). Limit: shadows and cracks; dark
    pictures.
    """
    return Features(np.asarray(cv2.Canny(image, low, high), np.uint8), FeatureKind.LINE)


def canny_auto(image: Image, view: GroundView, *, factor: Positive = 6.0, least: Positive = 12.0) -> Features:
    """Canny with thresholds that follow the light: high = ``factor`` medians of |∂x| + |∂y|, low half of it (B15).

    The median gradient is that of the asphalt's texture and of sensor noise. Source: R [74]. Limit: paint weaker
    than ``factor`` times the texture.
    """
    dx, dy = (cv2.Sobel(grey(image, view), cv2.CV_16S, *order) for order in ((1, 0), (0, 1)))
    texture = float(np.median(np.abs(dx[::2, ::2]).astype(np.int32) + np.abs(dy[::2, ::2])))
    high = max(least, factor * texture)
    return Features(np.asarray(cv2.Canny(dx, dy, high / 2, high), np.uint8), FeatureKind.LINE)


def sobel(image: Image, view: GroundView, *, least: Positive = 12.0) -> Features:
    """Upright edges: peaks along the row of |∂x| above ``least`` [grey/px], by (1, 2, 1) × (−1, 0, 1)/8 (B04).

    Only ∂x, so the edge of a shadow across the road gives no response (A16). Source: R [24], [52]–[54].
    Limit: upright edges that are no paint.
    """
    slope = cv2.Sobel(grey(image, view), cv2.CV_32F, 1, 0, scale=1 / 8)
    return upright_line(np.asarray(np.abs(slope), np.float32), least)


def prewitt(image: Image, view: GroundView, *, least: Positive = 12.0) -> Features:
    """Upright edges as :func:`sobel`, with equal weights: (1, 1, 1) × (−1, 0, 1)/6 (B05).

    Source: R [55]. Limit: as Sobel, and slanted edges.
    """
    slope = cv2.filter2D(grey(image, view), cv2.CV_32F, PREWITT)
    return upright_line(np.asarray(np.abs(slope), np.float32), least)


def edlines(image: Image, view: GroundView) -> Features:
    """Straight line segments, drawn one pixel wide (B06).

    Segments are those of LSD, which validates like EDLines (Helmholtz's principle); EDLines is not in OpenCV's main
    package. Source: R [56]; Akinlar and Topal, EDLines (2011). Limit: curves, which become chords.
    """
    lines = np.zeros(image.shape[:2], np.uint8)
    for ends in road_segments_px(grey(image, view), view):
        first, last = np.round(ends * 16).astype(int)
        cv2.line(lines, first.tolist(), last.tolist(), STROKE, 1, cv2.LINE_8, 4)
    return Features(lines, FeatureKind.LINE)
