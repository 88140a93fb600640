"""The trail of vehicles ahead in an odometry frame, the clothoid through it, and the blending from and to it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supervisor.path.fusion import Path
from trepid.clothoid import STANDING, Lane, Motion
from trepid.config import Settings
from trepid.types import Positive

Vector = NDArray[np.float64]


class TrailSettings(Settings):
    """Section ``follow.trail`` of ``config/supervisor.yaml``."""

    spacing_m: Positive  # detections within this distance are one point
    length_m: Positive  # ahead of the axle
    behind_m: Positive  # kept behind it, for the heading
    sigma_m: Positive  # of the lateral position of a detection directly ahead …
    sigma_per_m: Positive  # … and its growth with the distance
    least_sigma_m: Positive  # of many detections at one place, whose errors are correlated
    window_m: Positive  # scale of the weights of the fit, which fall with the distance
    offset_sigma_m: Positive  # standard deviation of the path without a trail: offset, …
    heading_sigma_rad: Positive
    curvature_sigma_1pm: Positive
    road_jerk_mps3: Positive  # limit of the curvature rate of roads at the present speed: κ' ≤ j/v³
    max_curvature_rate_1pm2: Positive  # … and at low speed


class Fit(NamedTuple):
    """A clothoid and its covariance."""

    lane: Lane
    covariance: Vector  # (4, 4) of y's coefficients: y(0), y'(0), κ, κ'

    def sigma_m(self, x_m: float) -> float:
        """Standard deviation of its lateral place at ``x_m``."""
        row = np.array([1.0, x_m, x_m**2 / 2, x_m**3 / 6])
        return math.sqrt(row @ self.covariance @ row)


class Trail:
    """Points in an odometry frame. Arguments and results are in the present frame of the vehicle."""

    def __init__(self, settings: TrailSettings) -> None:
        self._settings = settings
        self._points: list[tuple[float, float, float]] = []  # X, Y [m], weight Σ1/σ² [1/m²], oldest first
        self._begun = (0.0, 0.0)  # where the newest point began
        self._x_m = self._y_m = self._yaw_rad = 0.0

    def move(self, motion: Motion, dt_s: float) -> None:
        """Move the vehicle by ``motion``."""
        dx_m, dy_m, yaw_rad = motion.over(dt_s)
        cos, sin = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        self._x_m += dx_m * cos - dy_m * sin
        self._y_m += dx_m * sin + dy_m * cos
        self._yaw_rad += yaw_rad

    def add(self, x_m: float, y_m: float) -> None:
        """Add the present position of a vehicle."""
        s = self._settings
        cos, sin = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        at = (self._x_m + x_m * cos - y_m * sin, self._y_m + x_m * sin + y_m * cos)
        weight = (s.sigma_m + s.sigma_per_m * x_m) ** -2
        if self._points and math.dist(at, self._begun) < s.spacing_m:
            x, y, before = self._points[-1]
            share = weight / (before + weight)
            total = min(before + weight, s.least_sigma_m**-2)
            self._points[-1] = (x + share * (at[0] - x), y + share * (at[1] - y), total)
        else:
            self._begun = at
            self._points.append((*at, weight))

    def forget_beyond(self, x_m: float) -> None:
        """Drop the points farther ahead."""
        seen = self.visible_points()
        self._points = [p for p, keep in zip(self._points, (seen[:, 0] <= x_m).tolist(), strict=True) if keep]
        self._begun = (math.inf, math.inf)

    def visible_points(self) -> Vector:
        """Points (n, 3) from the vehicle: x, y [m] and weight, oldest first; points too far off are dropped."""
        if not self._points:
            return np.empty((0, 3))
        s, points = self._settings, np.array(self._points)
        cos, sin = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        dx_m, dy_m = points[:, 0] - self._x_m, points[:, 1] - self._y_m
        x_m, y_m = dx_m * cos + dy_m * sin, dy_m * cos - dx_m * sin
        kept = (x_m >= -s.behind_m) & (x_m <= s.length_m)
        if not kept.all():
            self._points = [point for point, keep in zip(self._points, kept.tolist(), strict=True) if keep]
        return np.column_stack([x_m, y_m, points[:, 2]])[kept]


def fit(
    points: Vector,
    prior: Lane,
    settings: TrailSettings,
    *,
    around_m: float,
    window_m: float,
    speed_mps: float,
) -> Fit:
    """The clothoid y(x) = y₀ + y₀'·x + κ·x²/2 + κ'·x³/6 that the points and ``prior`` make most likely.

    Bayesian linear regression: the prior has the standard deviations of the settings, κ' that of roads;
    points farther from ``around_m`` than about ``window_m`` hardly count.
    Bishop, Pattern Recognition and Machine Learning (2006), section 3.3.
    """
    s = settings
    offset_m, heading_rad, curvature_1pm, rate_1pm2, _ = prior
    mean = np.array([-offset_m, -heading_rad, curvature_1pm, rate_1pm2])
    rate_sigma_1pm2 = max_curvature_rate_1pm2(speed_mps, s) / 3
    sigmas = np.array([s.offset_sigma_m, s.heading_sigma_rad, s.curvature_sigma_1pm, rate_sigma_1pm2])
    x, y, weight = points.T
    rows = np.stack([np.ones_like(x), x, x**2 / 2, x**3 / 6])
    weighted = rows * (weight / (1 + ((x - around_m) / window_m) ** 4))
    covariance = np.linalg.inv(weighted @ rows.T + np.diag(sigmas**-2))
    y0, slope, curvature, rate = (covariance @ (weighted @ y + mean / sigmas**2)).tolist()
    return Fit(Lane(-y0, -slope, curvature, rate), covariance)


def max_curvature_rate_1pm2(speed_mps: float, settings: TrailSettings) -> float:
    """κ' ≤ j/v³: roads are laid out for at most the lateral jerk j at the speed driven there.

    AASHTO, A Policy on Geometric Design (2018), section 3.3.8.3.1, takes 0.3 to 0.9 m/s³ for spirals.
    """
    crawling = settings.max_curvature_rate_1pm2
    return min(crawling, settings.road_jerk_mps3 / max(speed_mps, 0.1) ** 3)


LEAD = "lead"


class HandOver:
    """Holds the difference of two paths where one replaces the other, and lets it fade.

    With Δ(x) the old path less the new one at the hand-over, seen from where the vehicle is now, the path is
    y_new(x) + w(τ)·Δ(x) with w(τ) = 1 − (10τ³ − 15τ⁴ + 6τ⁵), τ = t/T: place, slope and bend begin unchanged.
    """

    def __init__(self, over_s: float) -> None:
        self._over_s = over_s
        self._last: Path | None = None
        self._gap: Lane | None = None
        self._since_s = 0.0
        self._now_s = 0.0

    def step(self, path: Path | None, motion: Motion | None, *, now_s: float) -> Path | None:
        """``path``, blended from that of the last step."""
        moving, dt_s = motion or STANDING, now_s - self._now_s
        last, self._now_s = self._last, now_s
        if path is None:
            self._last = self._gap = None
            return None
        if last is not None and (last.source == LEAD) != (path.source == LEAD):
            here, there = last.lane.after(moving, now_s - last.t_s), path.lane.after(moving, now_s - path.t_s)
            self._gap = here.plus(there, -1.0)
            self._since_s = now_s
        elif self._gap is not None:
            self._gap = self._gap.after(Motion(moving.speed_mps, 0.0), dt_s)
        weight = 1.0 - _least_jerk((now_s - self._since_s) / self._over_s)
        if self._gap is None or weight <= 0.0:
            self._gap, self._last = None, path
            return path
        lane = path.lane.plus(self._gap, weight)
        self._last = path._replace(lane=lane)
        return self._last


def _least_jerk(share: float) -> float:
    """10τ³ − 15τ⁴ + 6τ⁵ for τ up to 1, then 1: Flash and Hogan, The coordination of arm movements (1985)."""
    t = min(share, 1.0)
    return t**3 * (10 - 15 * t + 6 * t**2)
