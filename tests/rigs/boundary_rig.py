"""Feature maps of lanes of known course, and how far boundaries lie from the truth in the picture."""

from collections.abc import Callable

import numpy as np

from perception.techniques.image.picture import (
    Boundaries,
    Boundary,
    FeatureKind,
    Features,
    GroundView,
    camera_view,
)
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

VIEW: GroundView = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
WIDTH_M = 3.4
Course = Callable[[np.ndarray], np.ndarray]  # y of the lane centre over x [m]


def arc(radius_m: float, offset_m: float = 0.0, heading_rad: float = 0.0) -> Course:
    """A lane centre on a circle, + to the left; ``inf`` is straight."""
    return lambda x: -offset_m - np.tan(heading_rad) * x + x**2 / 2 / radius_m


def sides(course: Course, x_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y), shape (n, 2), of the left and the right boundary, ±W/2 along the normal of the course."""
    slope = np.gradient(course(x_m), x_m)
    normal = np.column_stack([-slope, np.ones_like(x_m)]) / np.hypot(1, slope)[:, None]
    centre = np.column_stack([x_m, course(x_m)])
    return centre + WIDTH_M / 2 * normal, centre - WIDTH_M / 2 * normal


def features(
    course: Course,
    *,
    dashes: bool = False,
    outliers: float = 0.0,
    seed: int = 0,
    shown: tuple[bool, bool] = (True, True),
    far_m: float = 30.0,
) -> Features:
    """One pixel for each point of the boundaries; a share ``outliers`` of all lies up to 1 m aside."""
    x_m = np.arange(3.0, far_m, 0.02)
    painted = (x_m % 9.0 < 3.0) if dashes else np.full(len(x_m), True)
    lines = [side for side, seen in zip(sides(course, x_m), shown, strict=True) if seen]
    response = np.zeros((VIEW.height_px, VIEW.width_px), np.uint8)
    rng = np.random.default_rng(seed)
    for line in lines:
        alone = np.zeros_like(response)
        _mark(alone, line[painted])
        wanted = np.count_nonzero(alone) / (1 - outliers)
        while np.count_nonzero(alone) < wanted:
            beside = np.column_stack([np.zeros(10), rng.uniform(-1.0, 1.0, 10)])
            _mark(alone, line[rng.integers(len(line), size=10)] + beside)
        response |= alone
    return Features(response, FeatureKind.LINE)


def _mark(response: np.ndarray, ground_m: np.ndarray) -> None:
    pixel = np.round(VIEW.pixels(ground_m)).astype(int)
    inside = (pixel >= 0).all(axis=1) & (pixel[:, 0] < VIEW.width_px) & (pixel[:, 1] < VIEW.height_px)
    response[pixel[inside, 1], pixel[inside, 0]] = 255


def error_px(found: Boundary, course: Course, *, left: bool, far_m: float = 25.0) -> float:
    """Mean column distance in the picture between the found boundary and the truth."""
    x_m = np.arange(max(4.0, found.x_m[0]), min(far_m, found.x_m[-1]), 0.25)
    wide = np.arange(0.0, 40.0, 0.05)
    true = sides(course, wide)[0 if left else 1]
    true_y = np.interp(x_m, true[:, 0], true[:, 1])
    one = VIEW.pixels(np.column_stack([x_m, true_y]))
    two = VIEW.pixels(np.column_stack([x_m, found.at(x_m)]))
    return float(np.abs(one - two)[:, 0].mean())


def errors_px(found: Boundaries, course: Course) -> list[float]:
    """The errors of both sides; fails with the reason for a missing side."""
    assert found.left is not None and found.right is not None, found.reason
    return [error_px(found.left, course, left=True), error_px(found.right, course, left=False)]
