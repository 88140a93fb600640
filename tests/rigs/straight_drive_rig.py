"""Pairs of frames of a straight drive with a known camera, drawn from a plan view of a textured road."""

import math
from functools import cache

import cv2
import numpy as np

from cockpit.calibration.height import Step
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

KNOWN = load(CONFIG_DIR / "camera.yaml", Camera)
TRUE = KNOWN.model_copy(update={"pitch_down_rad": 0.09, "yaw_rad": -0.04, "height_m": 1.7})
LANE_M, SPEED_MPS, PERIOD_S = 3.3, 8.0, 0.04
WAVE_M = 40.0  # wavelength of the sway of the vehicle
PIXEL_M, LENGTH_M, HALF_M = 0.02, 110.0, 8.0  # of the plan view of the road
ROAD_HALF_M, LINE_M = 3.0, 0.12
FINER = 3  # oversampling of a frame
GREY, WHITE, YELLOW, GRASS, SKY = (105,) * 3, (225,) * 3, (60, 180, 225), (60, 120, 80), (220, 180, 150)
KINDS = {"white": (WHITE, WHITE), "yellow": (YELLOW, WHITE), "gravel": None}  # left and right line


@cache
def road_from_above(kind: str) -> np.ndarray:
    """The road along x (columns, from 0) by y (rows, from the left)."""
    rng = np.random.default_rng(3)
    size = round(2 * HALF_M / PIXEL_M), round(LENGTH_M / PIXEL_M)
    y_m = HALF_M - PIXEL_M * np.arange(size[0])
    column = np.full((size[0], 1, 3), GRASS, float)
    ragged = KINDS[kind] is None
    column[np.abs(y_m) < (HALF_M if ragged else ROAD_HALF_M)] = GREY
    for side, colour in zip((1, -1), KINDS[kind] or (), strict=False):
        column[np.abs(y_m - side * LANE_M / 2) < LINE_M / 2] = colour
    texture = np.zeros(size, np.float32)
    for cell_m, contrast in ((0.1, 25.0), (0.4, 12.0)) if ragged else ((0.1, 8.0), (0.4, 4.0)):
        small = rng.normal(0, contrast, (round(2 * HALF_M / cell_m), round(LENGTH_M / cell_m)))
        texture += cv2.resize(small.astype(np.float32), size[::-1], interpolation=cv2.INTER_LINEAR)
    return np.clip(column + texture[:, :, None], 0, 255).astype(np.uint8)


@cache
def rays(camera: Camera) -> np.ndarray:
    """Road places (x, y) [m] of the oversampled pixels, shape (rows, columns, 2); NaN above the horizon."""
    rows, columns = np.indices((FINER * camera.height_px, FINER * camera.width_px)).reshape(2, -1)
    pixels = (np.column_stack([columns, rows]) + 0.5) / FINER - 0.5
    return camera.road_from_pixel(pixels).reshape(FINER * camera.height_px, FINER * camera.width_px, 2)


def frame(
    kind: str, station_m: float, aside_m: float, heading_rad: float, curvature_1pm: float
) -> np.ndarray:
    """The image at a place of the road, whose bend begins at the vehicle."""
    x, y = rays(TRUE).transpose(2, 0, 1)
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    along, left = x * cos - y * sin, aside_m + x * sin + y * cos
    if curvature_1pm:
        radius_m = 1 / curvature_1pm
        along, left = (
            radius_m * np.arctan2(along, radius_m - left),
            radius_m - np.hypot(along, radius_m - left),
        )
    known = (along > 0) & (along < 60.0) & (np.abs(left) < HALF_M)
    column = np.where(known, (station_m + along) / PIXEL_M, -1).astype(np.float32)
    row = np.where(known, (HALF_M - left) / PIXEL_M, -1).astype(np.float32)
    image = cv2.remap(road_from_above(kind), column, row, cv2.INTER_LINEAR, borderValue=GRASS)
    image[np.isnan(x)] = SKY
    return cv2.resize(image, (TRUE.width_px, TRUE.height_px), interpolation=cv2.INTER_AREA)


@cache
def clip(kind: str, curvature_1pm: float = 0.0, sway_m: float = 0.12, frames: int = 10) -> tuple[Step, ...]:
    """Steps of a drive along the lane that sways by ``sway_m``."""
    rate = 2 * math.pi / WAVE_M

    def at(station_m: float) -> np.ndarray:
        aside_m, slope = sway_m * math.sin(rate * station_m), sway_m * rate * math.cos(rate * station_m)
        return frame(kind, station_m, aside_m, math.atan(slope), curvature_1pm)

    way_m = SPEED_MPS * PERIOD_S
    places = (10.0 + WAVE_M * np.arange(frames) / frames).tolist()
    return tuple(Step(at(place), at(place + way_m), way_m) for place in places)
