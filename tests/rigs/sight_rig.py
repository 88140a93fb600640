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


def misty(
    range_m: float, *, camera: Camera = CAMERA, texture: float = 0.1, wet: float = 0.0, seed: int = 0
) -> np.ndarray:
    """A straight road between fields as grey levels, (height, width), with texture and noise of the sensor.

    ``wet``: the share of the ground under water, which mirrors the sky by Schlick's approximation (1994).
    """
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    places = camera.road_from_pixel(np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 2)
    x_m, y_m = places[..., 0], places[..., 1]
    light = np.where(np.abs(y_m) < 3.4, ASPHALT, GRASS)
    for line_m in (-1.7, 1.7):
        light = np.where(np.abs(y_m - line_m) < 0.1, PAINT, light)
    light = light * (1 + texture * rng.standard_normal(light.shape))
    steep = camera.height_m / np.hypot(x_m - camera.x_m, camera.height_m)
    light = light + wet * AIRLIGHT * (0.02 + 0.98 * (1 - steep) ** 5)
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


def with_box(
    image: np.ndarray,
    ahead_m: float,
    *,
    left_m: float = 0.0,
    width_m: float = 2.5,
    tall_m: float = 3.4,
    colour: float | tuple[int, int, int] = 35,
    camera: Camera = CAMERA,
) -> np.ndarray:
    """``image`` with an upright board that faces the camera, its base ``ahead_m`` from the rear axle."""
    image = image.copy()
    (left, base), (right, _) = camera.pixel_from_road(
        [(ahead_m, left_m + side * width_m / 2) for side in (1, -1)]
    )
    ahead = ahead_m - camera.x_m
    top = camera.cy_px + camera.fy_px * np.tan(
        np.arctan2(camera.height_m - tall_m, ahead) - camera.pitch_down_rad
    )
    first, last = np.ceil([left, right]).clip(0).astype(int)
    image[max(int(np.ceil(top)), 0) : int(np.ceil(base)), first:last] = colour
    return image


def bend(
    radius_m: float, *, wall_m: float | None, tall_m: float = 2.5, camera: Camera = CAMERA, seed: int = 0
) -> np.ndarray:
    """A road on an arc, left for a positive radius, with trees at the horizon.

    ``wall_m``: distance of a concentric wall on the inside from the middle of the lane, negative
    outside; None: no wall.
    """
    rng, side, radius_m = np.random.default_rng(seed), np.sign(radius_m), abs(radius_m)
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    places = camera.road_from_pixel(np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 2)
    out_m = np.hypot(places[..., 0], radius_m - side * places[..., 1]) - radius_m  # outwards from the lane
    grey = np.where(np.isfinite(out_m), np.where((out_m > -1.7) & (out_m < 5.2), 80.0, 140.0), 210.0)
    for line_m in (-1.6, 1.6, 5.1):
        grey = np.where(np.abs(out_m - line_m) < 0.1, 220.0, grey)
    image = with_trees(np.clip(grey + rng.normal(0, 3, grey.shape), 0, 255).astype(np.uint8), camera=camera)
    if wall_m is None:
        return image
    # In plan a ray from the lens meets the circle of the wall at a root of a quadratic equation.
    for column in range(camera.width_px):
        tangent = side * (camera.cx_px - column) / camera.fx_px * np.cos(camera.pitch_down_rad)
        ray = np.array([1.0, tangent]) / np.hypot(1.0, tangent)
        eye = np.array([camera.x_m, -radius_m])
        half = eye @ ray
        root = half**2 - (eye @ eye - (radius_m - wall_m) ** 2)
        ahead = (-half - np.copysign(np.sqrt(max(root, 0.0)), wall_m)) * ray[0]
        if root <= 0 or ahead <= 0:
            continue
        ends = np.arctan2([camera.height_m - tall_m, camera.height_m], ahead) - camera.pitch_down_rad
        top, base = np.ceil(camera.cy_px + camera.fy_px * np.tan(ends)).astype(int)
        image[max(top, 0) : max(base, 0), column] = 45
    return image


def lit(light_at_m: float, *, noise_grey: float, camera: Camera = CAMERA, seed: int = 0) -> np.ndarray:
    """Ground by night, whose light falls with exp(-x/light_at_m) from grey 110, under a black sky."""
    rng = np.random.default_rng(seed)
    rows = np.arange(camera.height_px, dtype=float)
    x_m = camera.road_from_pixel(np.column_stack([np.full(len(rows), camera.cx_px), rows]))[:, 0]
    grey = np.where(np.isfinite(x_m), 110 * np.exp(-0.5 * np.nan_to_num(x_m) / light_at_m), 8.0)[:, None]
    image = np.repeat(grey, camera.width_px, axis=1) + rng.normal(0, noise_grey, (len(rows), camera.width_px))
    return np.clip(image, 0, 255).astype(np.uint8)


def sight_in(
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
