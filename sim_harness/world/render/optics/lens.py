"""Lens effects: distortion, stray light of the sun, drops and dirt on the windscreen, bloom, vignetting."""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.world.render.ground.noise import smooth_noise
from sim_harness.world.render.scene.view import in_colour
from trepid.car.camera import Camera
from trepid.types import Array, Floats, Image

FIXED_POINT_STEPS = 40
COARSE = 4  # stray light is smooth: it is computed for one pixel in 16
SUN_BGR = (0.62, 0.88, 1.0)
SUN_RAD = 0.028  # radius of the bloomed disc
STRAY_SPREAD_RAD = 1.0
GHOSTS = ((-0.35, 0.05, 0.05), (-0.7, 0.10, 0.025), (0.45, 0.035, 0.06), (-1.15, 0.16, 0.02))
"""Place between the sun (1) and its point reflection through the image centre (-1), radius, strength."""
WIPE_PERIOD_S = 1.6  # of the wipers
MAX_DROPS = 64
DROP_FIELD = 0.42  # of the image width in half a drop
MUD_BGR = (0.55, 0.72, 0.85)


class Distortion:
    """Distortion of Brown (1966) and Conrady (1919) in OpenCV's form: k1 k2 p1 p2 k3 k4 k5 k6.

    The scene is rendered by ``pinhole``, an undistorted camera that covers the field of view of the lens, and then
    warped.
    """

    def __init__(self, camera: Camera) -> None:
        """Raises ValueError when the distortion is not one-to-one or spreads the image over 10 times its size."""
        u, v = np.meshgrid(np.arange(camera.width_px, dtype=float), np.arange(camera.height_px, dtype=float))
        pixels = np.column_stack([u.ravel(), v.ravel()])
        with np.errstate(all="ignore"):  # it diverges where the distortion is refused below
            straight = undistort_pixels(camera, pixels)
        if not np.isfinite(straight).all() or np.abs(distort_pixels(camera, straight) - pixels).max() > 0.05:
            raise ValueError(f"distortion {camera.distortion} does not map the image one to one")
        low, high = np.floor(straight.min(axis=0)) - 1, np.ceil(straight.max(axis=0)) + 2
        size = (high - low).astype(int)
        if (size > 10 * np.array([camera.width_px, camera.height_px])).any():
            raise ValueError(f"distortion {camera.distortion} spreads the image over {size.tolist()} pixels")
        centre = {"cx_px": camera.cx_px - float(low[0]), "cy_px": camera.cy_px - float(low[1])}
        extent = {"width_px": int(size[0]), "height_px": int(size[1])}
        self.pinhole = camera.model_copy(update={"distortion": (), **extent, **centre})
        shape = (camera.height_px, camera.width_px)
        columns, rows = ((straight - low)[:, i].reshape(shape).astype(np.float32) for i in (0, 1))
        self._columns, self._rows = cv2.convertMaps(columns, rows, cv2.CV_16SC2)

    def bend(self, image: NDArray[Any]) -> NDArray[Any]:
        """The image of ``pinhole``, distorted by the lens."""
        return np.asarray(cv2.remap(image, self._columns, self._rows, cv2.INTER_LINEAR))


def undistort_pixels(camera: Camera, pixel: Array) -> Array:
    """Pixels (n, 2) of the undistorted image from those of the camera's own image."""
    criteria = (cv2.TERM_CRITERIA_COUNT, FIXED_POINT_STEPS, 0.0)
    points = cv2.undistortPoints(
        pixel[:, None], camera.intrinsics, camera.lens, P=camera.intrinsics, criteria=criteria
    )
    return np.asarray(points[:, 0], np.float64)


def distort_pixels(camera: Camera, pixel: Array) -> Array:
    """Pixels (n, 2) of the camera's own image from those of the undistorted image."""
    normalised = (pixel - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    rays, zero = np.column_stack([normalised, np.ones(len(pixel))]), np.zeros(3)
    points, _ = cv2.projectPoints(rays[:, None], zero, zero, camera.intrinsics, camera.lens)
    return np.asarray(points[:, 0], np.float64)


class StrayLight:
    """A low sun in or near the image: its disc, veiling glare, ghosts, and its reflection on the road."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        rows, columns = -(-camera.height_px // COARSE), -(-camera.width_px // COARSE)
        self._v, self._u = (np.mgrid[:rows, :columns] * COARSE + (COARSE - 1) / 2).astype(np.float32)

    def add(self, light: Floats, strength: float, *, bearing_rad: float, elevation_rad: float) -> Floats:
        """``light`` with the sun ``bearing_rad`` left of the camera's axis. Veil ~ 1/angle² (CIE 146, 2002)."""
        camera = self._camera
        bearing = math.remainder(bearing_rad, math.tau)
        if strength <= 0 or abs(bearing) > 1.4:
            return light
        sun_u = camera.cx_px - camera.fx_px * math.tan(bearing)
        sun_v = camera.cy_px - camera.fy_px * math.tan(camera.pitch_down_rad + elevation_rad)
        x, y = (self._u - sun_u) / camera.fx_px, (self._v - sun_v) / camera.fy_px
        away2 = np.minimum(x * x + y * y, 9)
        stray = 0.007 / (away2 + 0.010) + 0.16 * np.exp(-away2 / STRAY_SPREAD_RAD**2)
        stray *= 1 + 0.12 * np.cos(6 * np.arctan2(y, x) + 0.4) * np.exp(-away2 / 0.05)
        disc = 4 * np.exp(-away2 / SUN_RAD**2)
        total = strength * (stray + self._ghosts(sun_u, sun_v) + self._glitter(x, elevation_rad))
        grey = np.asarray(total + min(4 * strength, 1.0) * disc, np.float32)
        full = in_colour(grey) * np.array(SUN_BGR, np.float32)
        size = (light.shape[1], light.shape[0])
        wide = (self._u.shape[1] * COARSE, self._u.shape[0] * COARSE)
        spread = cv2.resize(full.astype(np.float32), wide, interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.add(light, np.ascontiguousarray(spread[: size[1], : size[0]])), np.float32)

    def _ghosts(self, sun_u: float, sun_v: float) -> Floats:
        camera = self._camera
        if not (0 <= sun_u < camera.width_px and 0 <= sun_v < camera.height_px):
            return np.zeros_like(self._u)
        total = np.zeros_like(self._u)
        for place, radius, strength in GHOSTS:
            u = camera.cx_px + place * (sun_u - camera.cx_px)
            v = camera.cy_px + place * (sun_v - camera.cy_px)
            away = np.hypot(self._u - u, self._v - v) / camera.fx_px
            total += strength / (1 + np.exp(np.clip((away - radius) * 150, -30, 30)))
        return total

    def _glitter(self, x: Floats, elevation_rad: float) -> Floats:
        """Forward scattering of the asphalt below the sun, brightest at the sun's elevation below the horizon."""
        down = (self._v - self._camera.horizon_row_px) / self._camera.fy_px
        across = np.exp(-0.5 * (x / (0.05 + 0.40 * np.maximum(down, 0))) ** 2)
        along = np.exp(-0.5 * ((down - elevation_rad) / 0.20) ** 2)
        return np.asarray(np.where(down > 0, 0.30 * across * along, 0), np.float32)


class Windscreen:
    """Dirt and drops on the windscreen, out of focus."""

    def __init__(self, camera: Camera, *, seed: int) -> None:
        self._camera = camera
        self._seed = seed
        self._mud = _mud(camera, seed)
        self._drops: tuple[tuple[int, int], tuple[Floats, Floats], Floats] | None = None

    def dirty(self, light: Floats, cover: float, veil: float) -> Floats:
        """Spots over a share of the image, nested for growing ``cover``, and a film that scatters light."""
        threshold = np.float32(np.quantile(self._mud, 1 - min(cover, 0.999)))
        opaque = 0.75 * np.clip((self._mud - threshold) / 0.8 + 0.45, 0, 1)
        soft = cv2.GaussianBlur(opaque, (0, 0), 0.018 * self._camera.fx_px)
        spots = in_colour(np.asarray(soft, np.float32))
        around = cv2.mean(light)[:3]
        mud = np.array(MUD_BGR, np.float32) * np.float32(0.30 * sum(around) / 3)
        hazy = light * np.float32(1 - veil) + np.array(around, np.float32) * np.float32(1.3 * veil)
        return np.asarray(hazy + spots * (mud - hazy), np.float32)

    def wet(self, light: Floats, count: float, t_s: float) -> Floats:
        """``light`` with drops, each of which images the scene small, upside down and blurred."""
        maps, cover = self._drop_maps(math.floor(t_s / WIPE_PERIOD_S), round(count))
        size = (light.shape[1] // COARSE, light.shape[0] // COARSE)
        small = cv2.blur(cv2.resize(light, size, interpolation=cv2.INTER_AREA), (3, 3))
        columns, rows = maps
        inside = cv2.remap(small, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(light + (inside - light) * in_colour(cover), np.float32)

    def _drop_maps(self, epoch: int, count: int) -> tuple[tuple[Floats, Floats], Floats]:
        """Source pixels in the reduced image of the pixels of drops, and the opacity of the drops."""
        if self._drops is not None and self._drops[0] == (epoch, count):
            return self._drops[1:]
        rows, columns = self._camera.height_px, self._camera.width_px
        rng = np.random.default_rng((self._seed, 31, epoch % 2**31))
        places = rng.random((MAX_DROPS, 2)) * (columns, rows)
        radii = self._camera.fx_px * (0.016 + 0.06 * rng.random(MAX_DROPS) ** 2.5)
        horizon = self._camera.horizon_row_px
        maps = (np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.float32))
        cover = np.zeros((rows, columns), np.float32)
        for (u, v), radius in zip(places[:count], radii, strict=False):
            r0, r1 = max(int(v - 2 * radius), 0), min(int(v + 2 * radius) + 2, rows)
            c0, c1 = max(int(u - 2 * radius), 0), min(int(u + 2 * radius) + 2, columns)
            y, x = np.mgrid[r0:r1, c0:c1].astype(np.float32)
            wide = DROP_FIELD * columns / radius  # every drop images the whole scene, upside down
            away = np.hypot(x - u, (y - v) * 0.88) / radius
            alpha = 0.8 / (1 + np.exp(np.clip((away - 0.9) * 9, -30, 30)))
            chosen = alpha > cover[r0:r1, c0:c1]
            for target, turned in zip(
                maps, (columns / 2 - wide * (x - u), horizon - wide * (y - v)), strict=True
            ):
                target[r0:r1, c0:c1][chosen] = turned[chosen] / COARSE
            cover[r0:r1, c0:c1] = np.maximum(cover[r0:r1, c0:c1], alpha)
        self._drops = ((epoch, count), maps, cover)
        return maps, cover


def _mud(camera: Camera, seed: int) -> Floats:
    """Order in which pixels are covered: splashes of several sizes, denser towards the bottom."""
    rng = np.random.default_rng((seed, 32))
    shape = (-(-camera.height_px // 32) * 32, -(-camera.width_px // 32) * 32)
    splashes = smooth_noise(rng, shape, (16, 16)) + 0.8 * smooth_noise(rng, shape, (32, 32))
    specks = smooth_noise(rng, shape, (8, 8))
    fine = 0.5 * smooth_noise(rng, shape, (4, 4))
    low = np.linspace(-0.25, 0.25, shape[0], dtype=np.float32)[:, None]
    return np.asarray((splashes + specks + fine + low)[: camera.height_px, : camera.width_px], np.float32)


def add_bloom(light: Floats) -> Floats:
    """``light`` with bloom: saturated areas spill into their neighbourhood."""
    over = np.clip(light - 1, 0, 6)
    size = (light.shape[1] // COARSE, light.shape[0] // COARSE)
    small = cv2.resize(over, size, interpolation=cv2.INTER_AREA)
    spill = cv2.GaussianBlur(small, (0, 0), light.shape[1] / COARSE / 40)
    return np.asarray(light + 0.12 * cv2.resize(spill, light.shape[1::-1]), np.float32)


def add_vignette(light: Floats, vignette: Image) -> Floats:
    """``light`` with vignetting; ``vignette``: relative grey levels, 255 = no loss."""
    share = np.asarray(vignette, np.float32) / np.float32(255)
    return np.asarray(light * share * share, np.float32)
