"""The model of all trackers: the motion of the lane, and the places of its boundaries (T01–T06, B26).

State x = (e, ψ, κ, W): offset, heading, curvature at the rear axle and width, as in trepid.clothoid. The two
boundaries share all of it, which is the structure of the road; so one boundary, or an old one, is enough.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from perception.techniques.image.picture import Boundaries, FrameMotion
from perception.techniques.steering.lane import draw_boundaries, ground_curve
from trepid.clothoid import Lane, advance_clothoid
from trepid.types import Array

E, PSI, KAPPA, WIDTH = range(4)
SAMPLES_M = np.array([5.0, 8.0, 12.0, 17.0, 23.0])  # ahead: where boundaries are compared with the state
PRIOR = np.array([0.0, 0.0, 0.0, 3.4])  # a lane before the first measurement …
PRIOR_SIGMA = np.array([1.0, 0.15, 0.02, 0.5])  # … and its σ
# σ a √m of (e, ψ, κ, W): slip, pitch and yaw of the car, joins of arcs, varying width
NOISE = np.array([0.015, 0.003, 0.0012, 0.01])
STILL_M = 0.05  # drift of a standing vehicle in a frame
MEASURED = np.array([0.08, 0.015, 0.004, 0.12])  # σ of (e, ψ, κ, W) of ground_curve in a clear frame
LINE_M, LINE_PER_M = 0.06, 0.008  # σ of a boundary's place: a constant, and a share of the distance (pitch)
FORGET_M, FORGET_S = 40.0, 4.0  # a track expires when it is unseen for longer
NEAR_M, FAR_M = 3.0, 25.0


def moved_state(state: Array, motion: FrameMotion) -> Array:
    """The state after ``motion`` (`trepid.clothoid`), shape (…, 4). A yaw rate of None: the lane is followed."""
    e, psi, kappa, width = (state[..., i] for i in range(4))
    follows = kappa * motion.distance_m
    turned = np.full_like(kappa, motion.turn_rad) if motion.yaw_rate_radps is not None else follows
    moved = advance_clothoid(
        e, psi, kappa, np.zeros_like(kappa), way_m=motion.distance_m, turned_rad=turned, sin=np.sin
    )
    return np.stack([*moved, width], axis=-1)


def transition(motion: FrameMotion) -> Array:
    """∂(moved state)/∂(state) for small angles, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[E, PSI] = motion.distance_m
    if motion.yaw_rate_radps is not None:
        matrix[E, KAPPA] = -(motion.distance_m**2) / 2
        matrix[PSI, KAPPA] = -motion.distance_m
    return matrix


def process_noise(motion: FrameMotion) -> Array:
    """Covariance added on the way, shape (4, 4)."""
    return np.diag(NOISE**2 * (abs(motion.distance_m) + STILL_M))


@dataclass(frozen=True)
class Samples:
    """Places of boundaries: y [m] at x [m], the side (+1 left, −1 right) and σ [m]; arrays of shape (n,)."""

    x_m: Array
    y_m: Array
    side: Array
    sigma_m: Array

    def __len__(self) -> int:
        return len(self.x_m)


def samples_of(boundaries: Boundaries) -> Samples:
    """The boundaries at ``SAMPLES_M``, as far as they reach; their errors are correlated, so n count as two."""
    parts = []
    for boundary, side in boundaries.signed_sides:
        inside = SAMPLES_M[(boundary.x_m[0] <= SAMPLES_M) & (boundary.x_m[-1] >= SAMPLES_M)]
        sigma = np.hypot(np.hypot(LINE_M, boundary.residual_m), LINE_PER_M * inside)
        sigma *= math.sqrt(max(1.0, len(inside) / 2))
        parts.append(np.stack([inside, boundary.at(inside), np.full(len(inside), side), sigma]))
    x_m, y_m, side_of, sigma_m = np.concatenate(parts, axis=1) if parts else np.empty((4, 0))
    return Samples(x_m, y_m, side_of, sigma_m)


def expected_offsets(state: Array, samples: Samples) -> Array:
    """y of the boundaries at ``samples``: −e/cosψ − x·tanψ + κx²/2cos³ψ ± W/2·√(1+y'²); shape (…, n) of (…, 4)."""
    e, psi, kappa, width = (state[..., i, None] for i in range(4))
    cos = np.cos(psi)
    slope = -np.tan(psi) + kappa * samples.x_m / cos**3
    centre = -e / cos - samples.x_m * np.tan(psi) + kappa * samples.x_m**2 / 2 / cos**3
    return np.asarray(centre + samples.side * width / 2 * np.sqrt(1 + slope**2), float)


def expected_slope(state: Array, samples: Samples, *, step: float = 1e-5) -> Array:
    """∂(expected)/∂(state) by central differences, shape (n, 4)."""
    nudge = step * np.eye(4)
    return (expected_offsets(state + nudge, samples) - expected_offsets(state - nudge, samples)).T / (
        2 * step
    )


@dataclass(frozen=True)
class TrackState:
    """Mean and covariance of the state, shapes (4,) and (4, 4), and the time and way since a measurement."""

    mean: Array
    covariance: Array
    unseen_s: float = 0.0
    unseen_m: float = 0.0

    def without_measurement(self, motion: FrameMotion) -> "TrackState":
        """The state after a frame without a measurement."""
        unseen_s, unseen_m = self.unseen_s + motion.dt_s, self.unseen_m + abs(motion.distance_m)
        return replace(self, unseen_s=unseen_s, unseen_m=unseen_m)

    @property
    def is_expired(self) -> bool:
        """Whether the lane has been unseen for too long."""
        return self.unseen_s > FORGET_S or self.unseen_m > FORGET_M

    def boundaries(self, reason: str) -> Boundaries:
        """The lane drawn from the mean; its support falls with the unseen way and time."""
        e, psi, kappa, width_m = self.mean.tolist()
        lane = Lane(e, psi, kappa, 0.0)
        support = math.exp(-self.unseen_s / FORGET_S - self.unseen_m / FORGET_M)
        residual_m = math.sqrt(max(float(self.covariance[E, E]), 0.0))
        both = draw_boundaries(
            lane, width_m, near_m=NEAR_M, far_m=FAR_M, residual_m=residual_m, support=support
        )
        return Boundaries(both.left, both.right, reason)


def initial(boundaries: Boundaries) -> TrackState | None:
    """The state of one frame alone: its curve, ``PRIOR`` where not measured; None without boundaries."""
    measured = ground_curve(boundaries)
    if measured is None:
        return None
    sigma = np.where([True, True, True, measured.width_m is not None], 2 * MEASURED, PRIOR_SIGMA)
    width_m = measured.width_m if measured.width_m is not None else PRIOR[WIDTH]
    mean = np.array([*measured.lane[:3], width_m])
    return TrackState(mean, np.diag(sigma**2))
