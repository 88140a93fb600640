"""Filters for painted lines: narrow bright stripes along the road (inventory A07, A15, B02, B11, B25, B32)."""

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.techniques.image.colour import grey, hsi
from perception.techniques.image.picture import FeatureKind, Features, GroundView
from perception.techniques.image.rows import row_means, row_top_hat, upright_line, width_px
from trepid.types import Floats, Image, OpenShare, Positive, Share

BLUR_PX = 1.2
LEAST_GREY = 4.0  # contrast of a region above sensor noise
YELLOW_RAD = 0.87  # hue of yellow paint, 50° from red: traffic yellow RAL 1023 has 48°
HUE_RAD = 0.44  # 25° to both sides


def dark_bright_dark(
    image: Image,
    view: GroundView,
    *,
    marking_m: Positive = 0.12,
    least: Positive = 7.0,
    noise: Positive = 3.0,
) -> Features:
    """Contrast [grey levels] of a stripe ``marking_m`` wide against the brighter of its neighbours (B02).

    With box means of that width on the road at −w, 0, +w: mean(0) − max(mean(−w), mean(+w)), at its maxima
    in the row and above ``least`` and ``noise`` mean absolute responses. A step edge gives 0. Source: R 1.1.
    Limit: wide or worn-out paint, and the dark outline of kerbs.
    """
    edges_m = (1.5 * marking_m, 0.5 * marking_m, -0.5 * marking_m, -1.5 * marking_m)
    left, middle, right = row_means(grey(image, view), edges_m, view)
    response = middle - np.maximum(left, right)
    response[~np.isfinite(view.pixel_m)] = 0
    return upright_line(response, max(least, noise * float(np.abs(response).mean())))


def top_hat(image: Image, view: GroundView, *, marking_m: Positive = 0.25, least: Positive = 8.0) -> Features:
    """Stripes brighter than the opening of their row by ``marking_m``, above Otsu's threshold and ``least`` (B25).

    Image − opening; the structuring element follows the distance. Source: R [75]. Limit: gravel and arrows.
    """
    hat = row_top_hat(grey(image, view), view, marking_m)
    if hat.any():
        least = max(least, cv2.threshold(hat[hat > 0].reshape(-1, 1), 0, 255, cv2.THRESH_OTSU)[0])
    return Features(np.where(hat > least, hat, np.uint8(0)), FeatureKind.LINE)


def oriented(
    image: Image,
    view: GroundView,
    *,
    marking_m: Positive = 0.12,
    along_m: Positive = 1.0,
    share: OpenShare = 0.975,
    least: Positive = 4.0,
) -> Features:
    """Second derivative of a Gaussian across the road, Gaussian along it; the highest ``1 − share`` of it (B32).

    f(u) ∝ exp(−u²/2σ²)·(1 − u²/σ²) across and exp(−v²/2σ_v²) along, with zero mean, σ half a marking and σ_v
    ``along_m``; a stripe of contrast c gives about c. For the view from above. Source: R [61]; Aly, Real time
    Detection of Lane Markers in Urban Streets, IV 2008. Limit: lines more than about 10° from straight ahead.
    """
    metre_px = 1 / float(np.nanmedian(view.pixel_m))
    across = _ricker(max(marking_m * metre_px / 2, 0.6))
    along = cv2.getGaussianKernel(2 * round(2 * along_m * metre_px) + 1, max(along_m * metre_px, 0.6))
    response = np.asarray(cv2.sepFilter2D(grey(image, view), cv2.CV_32F, across, along), np.float32)
    threshold = max(float(np.quantile(response, share)), least)
    return Features(np.where(response > threshold, response, np.float32(0)), FeatureKind.LINE)


def _ricker(sigma_px: float) -> NDArray[np.float64]:
    """exp(−u²/2σ²)(1 − u²/σ²), sum 0, its positive part of sum 1."""
    u = np.arange(-np.ceil(4 * sigma_px), np.ceil(4 * sigma_px) + 1)
    kernel = np.exp(-0.5 * (u / sigma_px) ** 2) * (1 - (u / sigma_px) ** 2)
    kernel -= kernel.mean()
    return np.asarray(kernel / kernel[kernel > 0].sum())


def wavelet(
    image: Image,
    view: GroundView,
    *,
    levels: Annotated[int, Field(ge=1, le=5)] = 3,
    upright: Annotated[float, Field(ge=0, le=4)] = 1.6,
    level: Share = 0.15,
) -> Image:
    """Wavelet reconstruction with details of upright edges times ``upright``, of level ones times ``level`` (B11).

    For the view from above, where markings are upright and the edges of shadows across the road are level. The
    spline smoothing S along rows (x) and columns (y), its taps 2^j pixels apart, splits the approximation a into
    S_xS_y·a, upright details (1 − S_x)S_y·a, level ones S_x(1 − S_y)·a and diagonal ones (1 − S_x)(1 − S_y)·a:
    gains of 1 restore the picture. Source: R [71]; Holschneider et al., algorithme à trous (1989).
    Limit: the ends of dashes and stop lines are damped too.
    """
    smooth = grey(image, view).astype(np.float32)
    details = np.zeros_like(smooth)
    for number in range(levels):
        taps = _spline(2**number)
        across, along = cv2.filter2D(smooth, -1, taps[None]), cv2.filter2D(smooth, -1, taps[:, None])
        coarser = cv2.filter2D(across, -1, taps[:, None])
        details += upright * (along - coarser) + level * (across - coarser)
        details += level * (smooth - across - along + coarser)
        smooth = np.asarray(coarser, np.float32)
    return np.asarray(np.clip((smooth + details).round(), 0, 255), np.uint8)


def _spline(apart: int) -> Floats:
    """The cubic spline's (1, 4, 6, 4, 1)/16 with its taps ``apart`` pixels from each other."""
    taps = np.zeros(4 * apart + 1, np.float32)
    taps[::apart] = np.array([1, 4, 6, 4, 1], np.float32) / 16
    return taps


def paint_colour(
    image: Image,
    view: GroundView,
    *,
    brighter: Positive = 0.10,
    pale: OpenShare = 0.25,
    coloured: OpenShare = 0.25,
) -> Features:
    """White: ``brighter`` than the road and pale; yellow: of that hue and coloured. Loose limits in HSI (A07, B23).

    Intensity is compared with the median below the horizon. Source: R [15], [66], [70]. Limit: pale gravel, white
    vehicles and sunlit patches.
    """
    road = np.isfinite(view.pixel_m)
    paint = np.zeros(image.shape[:2], np.uint8)
    if image.ndim == 2 or not road.any():
        return Features(paint, FeatureKind.LINE)
    hue, saturation, intensity = hsi(image[road])
    middle = float(np.median(intensity))
    white = (intensity > middle + brighter) & (saturation < pale)
    yellow = (np.abs(hue - YELLOW_RAD) < HUE_RAD) & (saturation > coloured) & (intensity > middle)
    paint[road] = np.where(white | yellow, 255, 0)
    return Features(paint, FeatureKind.LINE)


def mser_blue(
    image: Image,
    view: GroundView,
    *,
    widest_m: Positive = 0.4,
    slimness: Positive = 3.0,
    delta: Annotated[int, Field(ge=1, le=50)] = 6,
) -> Features:
    """Stable bright regions, slim as paint, of the blue channel (white) and of its enhanced form (yellow) (A15).

    A maximally stable region hardly changes while the threshold moves by ``delta`` levels. Blue stays bright in
    shadow by sky light; yellow paint is dark in it, hence the enhanced channel 2·((R+G)/2 − B). Kept are regions
    up to ``widest_m`` wide on the road and ``slimness`` times longer. Source: R [22], [23]; Matas et al. (2002).
    Limit: crumbled paint.
    """
    paint = np.zeros(image.shape[:2], np.uint8)
    if image.ndim == 2:
        return Features(paint, FeatureKind.LINE)
    widest_px = width_px(view, widest_m)
    largest = image.shape[0] * image.shape[1] // 20
    finder = cv2.MSER.create(
        delta=delta, min_area=15, max_area=max(largest, 16), max_variation=1.0, min_diversity=0.0
    )
    for plane in (image[:, :, 0], _yellowness(image)):
        # Blurred: OpenCV takes the least variation only where it is a strict minimum, and crisp paint has none.
        smooth = np.asarray(cv2.GaussianBlur(plane, (0, 0), BLUR_PX), np.uint8)
        for found in finder.detectRegions(smooth)[0]:
            region = np.asarray(found, np.int32)
            if _is_stripe(region, widest_px, slimness, smooth):
                paint[region[:, 1], region[:, 0]] = 255
    return Features(paint, FeatureKind.LINE)


def _yellowness(image: Image) -> Image:
    """2·((R+G)/2 − B), 0..255."""
    blue, green, red = cv2.split(image)
    rise = cv2.addWeighted(red, 0.5, green, 0.5, 0)
    return np.asarray(cv2.addWeighted(rise, 2.0, blue, -2.0, 0), np.uint8)


def _is_stripe(
    region: NDArray[np.int32], widest_px: NDArray[np.float64], slimness: float, plane: Image
) -> bool:
    """Narrow in its rows, long along its axis, and brighter than both sides of it."""
    columns, rows = region[:, 0], region[:, 1]
    top, bottom = int(rows.min()), int(rows.max())
    if bottom - top < 3:
        return False
    per_row = len(region) / (bottom - top + 1)
    if per_row > max(float(widest_px[top : bottom + 1].mean()), 2.0):
        return False
    spread = np.linalg.eigvalsh(np.cov(region.T.astype(float)))
    if spread[1] < slimness**2 * max(float(spread[0]), 0.1):
        return False
    aside = round(2 * per_row) + 1
    own = float(plane[rows, columns].mean())
    for beside in (columns - aside, columns + aside):
        inside = (beside >= 0) & (beside < plane.shape[1])
        if inside.any() and own < float(plane[rows[inside], beside[inside]].mean()) + LEAST_GREY:
            return False
    return True
