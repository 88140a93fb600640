"""What is known about the height and the focal length of a camera without a camera file.

Both are log-normal: the belief is a normal distribution of (ln h, ln f). Each piece of evidence is a measurement of
one sum of the two, and the belief after it the product of two normal densities (a Kalman update):

- the width of a lane between two lines, in heights of the camera: ln h, since lanes are W ± σ_W wide,
- dashes of known length, and the motion of the ground in the image over a known way: ln h + ln f,
- the motion of the image over a known turn: ln f

(:mod:`perception.camera.ground_fit` measures the last two). Evidence further from the belief than ``MAX_SURPRISE``
changes nothing: a width of a road or of half a lane, a wrong speed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.camera.ground_fit import Optics
from perception.camera.road_lines import pitch_and_yaw
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.messages import SIGMA_AHEAD_M, SteeringEstimate
from trepid.types import Array

QUARTERS = (-1.150, -0.319, 0.319, 1.150)  # medians of the quarters of a normal distribution
MAX_SURPRISE, MAX_SURPRISE_OF_FOCAL = 2.0, 3.0  # standard deviations of evidence from the belief
DASH_SIGMA = 0.08  # of f·h by dashes; half a degree of the horizon shifts it by as much
WAY_SIGMA, TURN_SIGMA = 0.03, 0.025  # of f·h and of f by odometry, from drive to drive


@dataclass(frozen=True, slots=True)
class CameraBelief:
    """Medians of height and focal length; standard deviations and correlation of their logarithms."""

    height_m: float
    height_sigma: float
    focal_px: float
    focal_sigma: float
    correlation: float = 0.0

    @property
    def heights_m(self) -> tuple[float, ...]:
        """Four equally likely heights: the median of each quarter of the distribution."""
        return tuple(self.height_m * math.exp(self.height_sigma * z) for z in QUARTERS)

    def place_variance_m2(self, lane: Lane, ahead_m: Sequence[float]) -> Array:
        """Variance [m²] of the lateral place of ``lane`` at distances ahead, by height and focal length.

        The lane is measured in the image. In a camera h/h₀ as high with f/f₀ of the focal length it has
        e·h/h₀, ψ·f₀/f, κ·(h₀/h)·(f₀/f)² and κ'·(h₀/h)²·(f₀/f)³, so that y = −e − ψ·x + κ·x²/2 + κ'·x³/6 changes by

            ∂y/∂ln h = −e − κ·x²/2 − κ'·x³/3,    ∂y/∂ln f = ψ·x − κ·x² − κ'·x³/2
        """
        x = np.array(ahead_m)
        bend, growth = lane.curvature_1pm * x**2, lane.curvature_rate_1pm2 * x**3
        by_height = (-lane.offset_m - bend / 2 - growth / 3) * self.height_sigma
        by_focal = (lane.heading_rad * x - bend - growth / 2) * self.focal_sigma
        return np.asarray(by_height**2 + by_focal**2 + 2 * self.correlation * by_height * by_focal)

    def given_width(self, width_heights: float, *, width_m: float, width_sigma_m: float) -> "CameraBelief":
        """The belief after a lane between two lines, ``width_heights`` heights of the camera wide."""
        return self._condition(
            (1, 0), math.log(width_m / width_heights), width_sigma_m / width_m, MAX_SURPRISE
        )

    def given_dashes(self, focal_height_pxm: float) -> "CameraBelief":
        """The belief after a line with dashes of known length, whose period in the image gives f·h."""
        return self._condition((1, 1), math.log(focal_height_pxm), DASH_SIGMA, MAX_SURPRISE)

    def given_optics(self, optics: Optics) -> "CameraBelief":
        """The belief after odometry against the motion of the ground.

        Where the drive turned, the focal length is measured, and from the way the height follows. Both must be
        likely: a wrong speed would pass for another height.
        """
        belief = self
        if optics.focal_px is not None:
            sigma = math.hypot(optics.focal_sigma, TURN_SIGMA)
            belief = self._condition((0, 1), math.log(optics.focal_px), sigma, MAX_SURPRISE_OF_FOCAL)
            if belief is self:
                return self
        sigma = math.hypot(optics.focal_height_sigma, WAY_SIGMA)
        after = belief._condition((1, 1), math.log(optics.focal_height_pxm), sigma, MAX_SURPRISE)
        return self if after is belief else after

    def _condition(self, row: tuple[int, int], seen: float, sigma: float, surprise: float) -> "CameraBelief":
        """The belief after the measurement ``seen`` ± ``sigma`` of row·(ln h, ln f); this one after a surprise."""
        mean, spread = np.log([self.height_m, self.focal_px]), [self.height_sigma, self.focal_sigma]
        covariance = np.outer(spread, spread) * [[1.0, self.correlation], [self.correlation, 1.0]]
        apart, variance = seen - mean @ row, np.dot(row, covariance @ row) + sigma**2
        if apart**2 > surprise**2 * variance:
            return self
        gain = covariance @ row / variance
        mean = mean + gain * apart
        covariance = covariance - np.outer(gain, gain) * variance
        height_sigma, focal_sigma = np.sqrt(np.diag(covariance)).tolist()
        height_m, focal_px = np.exp(mean).tolist()
        return CameraBelief(
            height_m,
            height_sigma,
            focal_px,
            focal_sigma,
            float(covariance[0, 1]) / (height_sigma * focal_sigma),
        )


def believed_camera(assumed: Camera, belief: CameraBelief, optics: Optics | None) -> Camera:
    """``assumed`` with the medians of ``belief``, and the horizon and direction of driving of ``optics``."""
    lens = {"fx_px": belief.focal_px, "fy_px": belief.focal_px, "height_m": belief.height_m}
    camera = assumed.model_copy(update=lens)
    if optics is None:
        return camera
    return turn_camera(optics, camera, assumed)


def turn_camera(optics: Optics, lens: Camera, first: Camera) -> Camera:
    """``lens`` towards the horizon and the direction that ``optics`` gives relative to the camera ``first``.

    Without a direction the yaw stays.
    """
    place_px = first.cx_px - (optics.aside_px or 0.0), first.horizon_row_px - optics.horizon_px
    turned = pitch_and_yaw(*place_px, lens)
    if optics.aside_px is None:
        del turned["yaw_rad"]
    return lens.model_copy(update=turned)


def with_camera_doubt(estimate: SteeringEstimate, belief: CameraBelief) -> SteeringEstimate:
    """``estimate`` with the uncertainty of the camera in ``ahead_sigma_m``, where it states one."""
    lane = Lane.of_message(estimate)
    if lane is None or not estimate.ahead_sigma_m:
        return estimate
    variance = np.square(estimate.ahead_sigma_m) + belief.place_variance_m2(lane, SIGMA_AHEAD_M)
    return replace(estimate, ahead_sigma_m=tuple(np.sqrt(variance).tolist()))
