"""Pictures of flat ground under a sky in air of a known range, drawn by Koschmieder's law."""

import numpy as np

from perception.sight.observer import Sight, SightObserver
from perception.sight.settings import SightSettings
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate

SETTINGS = load(CONFIG_DIR / "sight.yaml", SightSettings)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
AIRLIGHT = 0.62
ASPHALT, PAINT, GRASS = 0.10, 0.45, 0.20


def misty(range_m: float, *, camera: Camera = CAMERA, texture: float = 0.1, seed: int = 0) -> np.ndarray:
    """A straight road between fields as grey levels, (height, width), with texture and noise of the sensor."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    places = camera.road_from_pixel(np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 2)
    x_m, y_m = places[..., 0], places[..., 1]
    light = np.where(np.abs(y_m) < 3.4, ASPHALT, GRASS)
    for line_m in (-1.7, 1.7):
        light = np.where(np.abs(y_m - line_m) < 0.1, PAINT, light)
    light = light * (1 + texture * rng.standard_normal(light.shape))
    passed = np.where(np.isfinite(x_m), np.exp(-3 * (x_m - camera.x_m) / range_m), 0.0)
    seen = AIRLIGHT + (np.where(np.isfinite(light), light, 0.0) - AIRLIGHT) * passed
    return np.clip(255 * np.sqrt(np.maximum(seen, 0)) + rng.normal(0, 1, seen.shape), 0, 255).astype(np.uint8)


def with_trees(image: np.ndarray, *, camera: Camera = CAMERA, seed: int = 0) -> np.ndarray:
    """``image`` with dark trees of random height along the horizon."""
    rng, image = np.random.default_rng(seed), image.copy()
    horizon = round(camera.horizon_row_px)
    for column in range(0, camera.width_px, 4):
        image[horizon - int(rng.integers(3, 14)) : horizon + 1, column : column + 4] = rng.integers(40, 80)
    return image


def lit(light_at_m: float, *, noise_grey: float, camera: Camera = CAMERA, seed: int = 0) -> np.ndarray:
    """Ground by night, whose light falls with exp(-x/light_at_m) from grey 110, under a black sky."""
    rng = np.random.default_rng(seed)
    rows = np.arange(camera.height_px, dtype=float)
    x_m = camera.road_from_pixel(np.column_stack([np.full(len(rows), camera.cx_px), rows]))[:, 0]
    grey = np.where(np.isfinite(x_m), 110 * np.exp(-0.5 * np.nan_to_num(x_m) / light_at_m), 8.0)[:, None]
    image = np.repeat(grey, camera.width_px, axis=1) + rng.normal(0, noise_grey, (len(rows), camera.width_px))
    return np.clip(image, 0, 255).astype(np.uint8)


def seen_in(
    image: np.ndarray, *, camera: Camera = CAMERA, lane: SteeringEstimate | None = None
) -> Sight | None:
    """The sight in ``image`` as the first frame."""
    return SightObserver(SETTINGS, camera).step(Frame(t_s=0.0, image=image), lane)


def arc(curvature_1pm: float, *, confidence: float = 0.9) -> SteeringEstimate:
    """A lane that bends evenly."""
    return SteeringEstimate(
        t_s=0.0,
        estimator="cv",
        lateral_offset_m=0.0,
        heading_error_rad=0.0,
        curvature_1pm=curvature_1pm,
        curvature_rate_1pm2=0.0,
        lookahead_m=8.0,
        confidence=confidence,
        reason="",
    )
