"""The lane as a clothoid seen from the vehicle, and how it moves as the vehicle does."""

from math import cos, sin
from typing import NamedTuple


class Motion(NamedTuple):
    """How the vehicle moves: speed of the rear axle [m/s], yaw rate [rad/s, + left]."""

    speed_mps: float
    yaw_rate_radps: float

    def over(self, dt_s: float) -> tuple[float, float, float]:
        """Displacement (x [m], y [m], yaw [rad]) in the frame of now after ``dt_s``: chord of an arc."""
        speed_mps, yaw_rate_radps = self
        yaw_rad = yaw_rate_radps * dt_s
        way_m = speed_mps * dt_s
        return way_m * cos(yaw_rad / 2), way_m * sin(yaw_rad / 2), yaw_rad


STANDING = Motion(0.0, 0.0)


class Lane(NamedTuple):
    """Lane centre y(x) = -e - ψ·x + κ·x²/2 + κ'·x³/6 [m], curvature κ at the rear axle."""

    offset_m: float  # e, + = vehicle left of the centre
    heading_rad: float  # ψ, vehicle minus lane
    curvature_1pm: float  # κ at the axle
    curvature_rate_1pm2: float  # κ'

    def y_m(self, x_m: float) -> float:
        """Lateral place of the lane centre at ``x_m`` ahead, + left."""
        offset_m, heading_rad, curvature_1pm, rate_1pm2 = self
        curve = curvature_1pm / 2 + rate_1pm2 * x_m / 6
        return -offset_m - heading_rad * x_m + curve * x_m**2

    def after(self, motion: Motion, dt_s: float) -> "Lane":
        """The same lane from where the vehicle is ``dt_s`` later; small angles between vehicle and lane."""
        x_m, y_m, yaw_rad = motion.over(dt_s)
        _, heading_rad, curvature_1pm, rate_1pm2 = self
        bend_rad = curvature_1pm * x_m + rate_1pm2 * x_m**2 / 2
        return Lane(
            y_m - self.y_m(x_m),
            heading_rad + yaw_rad - bend_rad,
            curvature_1pm + rate_1pm2 * x_m,
            rate_1pm2,
        )


def pursuit_curvature_1pm(y_m: float, lookahead_m: float) -> float:
    """κ_cmd = 2·y(ℓ)/ℓ²: the arc from the axle to the lane centre at ℓ (Coulter, CMU-RI-TR-92-01)."""
    return 2 * y_m / lookahead_m**2


def mean_lane(lanes: list[Lane], weights: list[float]) -> Lane:
    """Mean of lanes that agree, component by component; ``weights`` sum to 1."""
    offset_m = heading_rad = curvature_1pm = curvature_rate_1pm2 = 0.0
    for (offset, heading, curvature, rate), weight in zip(lanes, weights, strict=True):
        offset_m += weight * offset
        heading_rad += weight * heading
        curvature_1pm += weight * curvature
        curvature_rate_1pm2 += weight * rate
    return Lane(offset_m, heading_rad, curvature_1pm, curvature_rate_1pm2)
