"""A camera source: drawn frames of a straight lane, for a drive without a camera."""

import time

import cv2
import numpy as np
from pydantic import PositiveFloat, PositiveInt

from trepid import config
from trepid.car.camera import Camera
from trepid.messages import Frame
from vehicle.cameras.source import SourceContext, Values


class DrawnLane:
    """Frames of a road with two white lines to the horizon. Noise differs from frame to frame, as in a camera."""

    class Settings(config.Settings):
        """The block ``drawn_lane`` of camera_source.yaml; the scene is that of the default camera."""

        rate_hz: PositiveFloat = 25.0
        lane_width_m: PositiveFloat = 3.5
        seed: PositiveInt = 1

    def __init__(self, settings: Settings, drive: SourceContext) -> None:
        camera = config.load(config.CONFIG_DIR / "camera.yaml", Camera)
        self._period_s, self._now_s = 1.0 / settings.rate_hz, drive.now_s
        self._random = np.random.default_rng(settings.seed)
        self._road = _road(camera, settings.lane_width_m)
        self._next_s = drive.now_s()

    def read(self, *, timeout_s: float) -> Frame | None:
        """The next frame at its time; None when that is later than ``timeout_s``."""
        wait_s = self._next_s - self._now_s()
        if wait_s > timeout_s:
            time.sleep(timeout_s)
            return None
        time.sleep(max(wait_s, 0.0))
        t_s = self._now_s()
        self._next_s = max(self._next_s + self._period_s, t_s)
        noise = self._random.normal(0.0, 4.0, self._road.shape)
        return Frame(t_s=t_s, image=np.clip(self._road + noise, 0, 255).astype(np.uint8))

    @property
    def ended(self) -> bool:
        """Never."""
        return False

    @property
    def trouble(self) -> str:
        """Nothing can be wrong with a drawing."""
        return ""

    def values(self) -> Values:
        """No values."""
        return ()

    def close(self) -> None:
        """Nothing is open."""


def _road(camera: Camera, lane_width_m: float) -> np.ndarray:
    """The picture without noise: sky, asphalt, and lines 0.12 m wide on both sides of the car."""
    image = np.full((camera.height_px, camera.width_px, 3), 90.0)
    ahead_m = np.linspace(2.0, 60.0, 200)
    horizon_px = int(camera.cy_px - camera.fy_px * np.tan(camera.pitch_down_rad))
    image[: max(horizon_px, 0)] = (200.0, 170.0, 140.0)
    for left_m in (lane_width_m / 2, -lane_width_m / 2):
        edges = [np.stack([ahead_m, np.full_like(ahead_m, left_m + side)], 1) for side in (0.06, -0.06)]
        outline = np.concatenate([edges[0], edges[1][::-1]])
        pixels = np.array([_pixel(camera, x_m, y_m) for x_m, y_m in outline])
        cv2.fillPoly(image, [np.round(pixels).astype(np.int32)], (235.0, 235.0, 235.0))
    return image


def _pixel(camera: Camera, x_m: float, y_m: float) -> tuple[float, float]:
    """The pixel of a point of the road, in the frame of the rear axle, for a camera without yaw."""
    ahead_m, left_m, down_m = x_m - camera.x_m, y_m - camera.y_m, camera.height_m
    sin, cos = np.sin(camera.pitch_down_rad), np.cos(camera.pitch_down_rad)
    depth_m, below_m = cos * ahead_m + sin * down_m, cos * down_m - sin * ahead_m
    return camera.cx_px - camera.fx_px * left_m / depth_m, camera.cy_px + camera.fy_px * below_m / depth_m
