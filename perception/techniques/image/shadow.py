"""Removal of cast shadows (inventory A14)."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from perception.techniques.image.picture import GroundView
from perception.techniques.image.rows import row_top_hat
from trepid.types import Floats, Image, Mask, Positive

DARK = 4.0  # grey levels added before the logarithm: colour below is noise
ANGLES = np.deg2rad(np.arange(0.0, 91.0, 5.0))  # sky light is bluer: ln R/G falls while ln B/G rises
BINS = 64
SUNNY = 75.0  # percentile of brightness above which pixels lie in the sun
NEAR_PX = 2  # width of the penumbra
TOGETHER = 0.4  # least step of a channel at the edge of a shadow, as a share of the greatest
STRIPE_GREY = 8.0  # least contrast of paint


def without_shadows(
    image: Image,
    view: GroundView,
    *,
    step: Positive = 0.08,
    material: Positive = 0.06,
    marking_m: Positive = 0.30,
) -> Image:
    """The picture without cast shadows: zero their edges, then integrate the gradient again (A14).

    1. Invariant g = cosθ·ln(R/G) + sinθ·ln(B/G) with the θ of least entropy of g.
    2. Shadow edges: ∇ln I above ``step`` in all channels alike with ∇g below ``material``. White paint on
       grey asphalt has no step in g either, so a stripe as narrow as a marking is never a shadow edge.
    3. Re-integration: the picture whose gradient is ∇ln I without those edges, min ‖∇u − p‖² (Poisson, with no flow
       through the border).

    Source: R [21]; Finlayson, Hordley, Lu and Drew, On the Removal of Shadows from Images, IEEE PAMI 28(1), 2006.
    Limit: the edge between two grey surfaces (asphalt and concrete), which is removed too.
    """
    if image.ndim == 2:
        return image
    road = np.isfinite(view.pixel_m)  # the sky is unchanged
    shadow = shadow_edges(image, view, step=step, material=material, marking_m=marking_m)[road]
    if not shadow.any():
        return image
    logs = np.log(image[road].astype(np.float32) + DARK)
    flat = np.stack([reintegrate(logs[:, :, i], shadow) for i in range(3)], axis=2)
    shift = logs - flat  # one value in the sun, others in each shadow
    sunny = shift.mean(axis=2) >= np.percentile(shift.mean(axis=2), SUNNY)
    clean = image.copy()
    clean[road] = np.clip(np.exp(flat + np.median(shift[sunny], axis=0)) - DARK, 0, 255)
    return clean


def shadow_edges(image: Image, view: GroundView, *, step: float, material: float, marking_m: float) -> Mask:
    """Pixels of a BGR image on the edge of a cast shadow."""
    logs = np.log(image.astype(np.float32) + DARK)
    smooth = cv2.GaussianBlur(logs, (0, 0), 1.0)
    g_x, g_y = _gradient(invariant(smooth))
    edge = _dims_all(smooth, step) & (cv2.magnitude(g_x, g_y) < material)
    hat = row_top_hat(np.asarray(image.max(axis=2), np.uint8), view, marking_m)
    grown = np.ones((2 * NEAR_PX + 1, 2 * NEAR_PX + 1), np.uint8)
    paint = cv2.dilate((hat > STRIPE_GREY).astype(np.uint8), grown) > 0
    edge &= ~paint
    return np.asarray(cv2.dilate(edge.astype(np.uint8), grown) > 0) & ~paint


def _dims_all(logs: Floats, step: float) -> Mask:
    """Pixels where ln I steps by more than ``step`` and every channel has a share of it in the same direction."""
    dx, dy = _gradient(logs)
    mean_x, mean_y = dx.mean(axis=2), dy.mean(axis=2)
    size = np.maximum(np.hypot(mean_x, mean_y), 1e-6)
    along = (dx * mean_x[..., None] + dy * mean_y[..., None]) / size[..., None]
    return np.asarray((size > step) & (along.min(axis=2) > TOGETHER * along.max(axis=2)))


def invariant(logs: Floats) -> Floats:
    """g = cosθ·ln(R/G) + sinθ·ln(B/G) of log BGR, with the θ of least entropy (Finlayson et al. 2004)."""
    x, y = logs[:, :, 2] - logs[:, :, 1], logs[:, :, 0] - logs[:, :, 1]
    few = x[::4, ::4].ravel(), y[::4, ::4].ravel()
    theta = min(ANGLES, key=lambda angle: _entropy(np.cos(angle) * few[0] + np.sin(angle) * few[1]))
    return np.asarray(np.cos(theta) * x + np.sin(theta) * y, np.float32)


def _entropy(values: NDArray[np.floating]) -> float:
    """−Σ p·ln p [nat] of the middle 90 % of ``values`` in ``BINS`` bins, plus the log of the width of a bin."""
    low, high = np.percentile(values, [5, 95])
    if high - low < 1e-6:
        return -np.inf
    counts = np.histogram(values, BINS, (low, high))[0]
    share = counts[counts > 0] / counts.sum()
    return float(-(share * np.log(share)).sum() + np.log((high - low) / BINS))


def _gradient(values: Floats) -> tuple[Floats, Floats]:
    """∂/∂x and ∂/∂y per pixel (Sobel)."""
    across, down = (
        cv2.Sobel(values, cv2.CV_32F, 1, 0, scale=1 / 8),
        cv2.Sobel(values, cv2.CV_32F, 0, 1, scale=1 / 8),
    )
    return np.asarray(across, np.float32), np.asarray(down, np.float32)


def reintegrate(values: Floats, without: Mask) -> Floats:
    """The image of mean 0 whose differences are those of ``values``, but 0 at ``without``.

    Least squares: ∇²u = div p with ∂u/∂n = 0. The cosine transform makes the Laplacian diagonal,
    2cos(πi/h) + 2cos(πj/w) − 4.
    """
    dx, dy = np.diff(values, axis=1), np.diff(values, axis=0)
    dx[without[:, 1:] | without[:, :-1]] = 0
    dy[without[1:] | without[:-1]] = 0
    divergence = np.zeros(values.shape)
    divergence[:, :-1] += dx
    divergence[:, 1:] -= dx
    divergence[:-1] += dy
    divergence[1:] -= dy
    height, width = values.shape
    down = 2 * np.cos(np.pi * np.arange(height) / height)
    across = 2 * np.cos(np.pi * np.arange(width) / width)
    eigen = down[:, None] + across - 4
    eigen[0, 0] = 1.0
    spectrum = dctn(divergence, type=2, norm="ortho") / eigen
    spectrum[0, 0] = 0.0
    return np.asarray(idctn(spectrum, type=2, norm="ortho"), np.float32)
