"""Speed of a car from its images: the ground ahead, in heights of the camera.

Relative to the horizon row a point of the ground at the distance x lies at v = f·h/x, so that the way between two
frames is Δ = f·h·(1/v − 1/v′) (:mod:`perception.camera.ground_flow`). It has the scale of the height: with an
assumed camera these are the metres of its world.
"""

from collections.abc import Sequence

import numpy as np

from perception.camera.grey import grey
from perception.camera.ground_flow import GroundInImage, track_corners
from trepid.car.camera import Camera
from trepid.types import Array, Image

SPEEDS_HPS = np.geomspace(0.5, 30.0, 24)  # [heights of the camera per second] that are tried
LOOKS = 24  # pairs of frames, spread over the drive
NEAR = 0.2  # share of the tried way by which a corner may differ


def speed_mps(frames: Sequence[Image], t_s: Array, camera: Camera) -> float | None:
    """The speed [m/s] at which most corners of the ground move; None where none do.

    The median of the corners that are tracked from that speed.
    """
    pairs = np.unique(np.linspace(0, len(frames) - 2, LOOKS).astype(int)).tolist()
    found = [
        _speeds_mps(frames, t_s, camera, pairs, share * camera.height_m) for share in SPEEDS_HPS.tolist()
    ]
    best = max(found, key=len)
    return float(np.median(best)) if len(best) else None


def _speeds_mps(
    frames: Sequence[Image], t_s: Array, camera: Camera, pairs: Sequence[int], tried_mps: float
) -> Array:
    """Speeds of the corners that agree with the tried one."""
    fh, speeds = camera.fx_px * camera.height_m, []
    for first in pairs:
        dt_s = float(t_s[first + 1] - t_s[first])
        before, after = grey(frames[first]), grey(frames[first + 1])
        moved = track_corners(
            before, after, GroundInImage(camera, camera.fx_px, fh), tried_mps * dt_s, None, dt_s
        )
        speeds.append(fh * moved.nearer[moved.after_px[:, 1] > 0] / dt_s)
    every = np.concatenate(speeds) if speeds else np.empty(0)
    return every[np.abs(every / tried_mps - 1) < NEAR]
