"""The robust fit of a lane to boundary points under a Gaussian prior."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.linalg.lapack import dposv

from perception.lane.model.geometry import (
    KAPPA,
    KAPPA_RATE,
    PITCH,
    PSI,
    WIDTH,
    LaneState,
    RoadPoints,
    lane_derivatives,
    level_points,
)
from trepid.car.camera import Camera
from trepid.config import Settings
from trepid.types import Array, NonNegative, Positive

IDENTITY = np.eye(6)
MIN_POINTS_FOR_PITCH = 8  # on the boundary with fewer
MAX_MODEL_ERROR_M = 2.0  # a point with the error of half a lane has no weight left
SMALL_STEP = 0.2  # standard deviations of the state; a smaller step ends the iteration


class FitSettings(Settings):
    """Section ``fit`` of ``config/perception.yaml``."""

    iterations: Annotated[int, Field(ge=1, le=10)]
    gate_m: Positive
    robust_scale_m: Positive
    gate_growth: NonNegative
    points_per_boundary: Positive
    bend_doubt: NonNegative
    straight_log_odds: float


@dataclass(frozen=True)
class LaneSolution:
    """A fitted state; per point the residual [m] and the final weight (0 = rejected)."""

    state: LaneState
    residual_m: Array
    weight: Array


def fit_lane(
    points: RoadPoints, side: Array, prior: LaneState, start: Array, camera: Camera, settings: FitSettings
) -> LaneSolution:
    """Maximum a posteriori lane for ``points`` on the left (side +1) or right (−1) boundary.

    Gauss-Newton on r = d(p; x) − side·W/2 with Cauchy weights and the prior N(x̄, P): with the information N
    = Σ w·HᵀH/σ², x = x̄ + (P⁻¹ + N)⁻¹·Σ w·Hᵀ/σ²·(H·(x_k − x̄) − r). The points of a boundary share their
    errors (one line of paint, one camera), so all together they count as ``points_per_boundary`` points. The
    pitch is estimated only with both boundaries, from how they converge: with one it is ambiguous with a
    bend.
    """
    precision = inverse(prior.covariance)
    mean = start.copy()
    points = _with_model_error(points, start, settings)
    shared = _shared_weight(points, side, settings)
    scale = _robust_scale(points, settings)
    gate = settings.gate_m + settings.gate_growth * points.x_m + points.sigma_m
    residual = weight = shared
    information = precision
    left = int(np.count_nonzero(side > 0))
    both = min(left, len(side) - left) >= MIN_POINTS_FOR_PITCH
    for iteration in range(settings.iterations):
        residual, jacobian = _residuals(points, side, mean, camera)
        if not both:
            jacobian[PITCH] = 0
        near = np.abs(residual) < (gate if iteration else gate + settings.gate_m)
        weight = shared / (1 + np.square(residual / scale)) * near
        weighted = jacobian * weight
        information = precision + weighted @ jacobian.T
        right_side = weighted @ ((mean - prior.mean) @ jacobian - residual)
        before, mean = mean, _limit_state(prior.mean + solve_positive(information, right_side))
        step = mean - before
        residual = residual + step @ jacobian
        if iteration and step @ information @ step < SMALL_STEP**2:
            break
    return LaneSolution(
        state=LaneState(mean=mean, covariance=inverse(information)), residual_m=residual, weight=weight
    )


def solve_positive(matrix: Array, right_side: Array) -> Array:
    """x of M·x = b for a symmetric positive definite M, by Cholesky; ten times as fast as numpy.linalg.

    Raises numpy.linalg.LinAlgError when M is not positive definite.
    """
    _, solution, failed = dposv(matrix, right_side)
    if failed:
        raise np.linalg.LinAlgError(f"not positive definite: {matrix}")
    return np.asarray(solution, np.float64)


def inverse(matrix: Array) -> Array:
    """M⁻¹ of a symmetric positive definite M, symmetric to the last bit."""
    found = solve_positive(matrix, IDENTITY)
    return (found + found.T) / 2


def log_evidence(
    fitted: LaneSolution, points: RoadPoints, side: Array, prior: LaneState, settings: FitSettings
) -> float:
    """Log evidence of ``prior``: log ∫ p(points | x)·p(x) dx up to a constant, by Laplace's approximation.

    A looser prior costs log|P⁻¹ + N|/|P⁻¹|, so a bend wins only if the points require it (MacKay, Information
    Theory, Inference, and Learning Algorithms, 2003, chapter 28).
    """
    scale = _robust_scale(points, settings)
    shared = _shared_weight(points, side, settings)
    misfit = float(np.sum(shared * scale**2 * np.log1p((fitted.residual_m / scale) ** 2)))
    change = fitted.state.mean - prior.mean
    surprise = float(change @ np.linalg.solve(prior.covariance, change))
    occam = np.linalg.slogdet(prior.covariance)[1] - np.linalg.slogdet(fitted.state.covariance)[1]
    return -0.5 * (misfit + surprise + float(occam))


def _limit_state(mean: Array) -> Array:
    """The state limited to the range of the linearisation: |ψ| ≤ 0.7, |κ0| ≤ 0.12, |κ'| ≤ 0.02."""
    mean[PSI] = min(max(mean[PSI], -0.7), 0.7)
    mean[KAPPA] = min(max(mean[KAPPA], -0.12), 0.12)
    mean[KAPPA_RATE] = min(max(mean[KAPPA_RATE], -0.02), 0.02)
    return mean


def _with_model_error(points: RoadPoints, start: Array, settings: FitSettings) -> RoadPoints:
    """``points`` with σ increased by the error of a single clothoid on a road that bends as ``start`` does.

    A bend of curvature κ driven at v = √(a/κ) begins and ends with κ' = j/v³ = j·(κ/a)^{3/2}. If that happens
    halfway to the station s, the clothoid is off by κ'·(s/2)³/6 there: σ = ``bend_doubt``·κ^{3/2}·s³.
    """
    reach = points.x_m
    kappa = np.maximum(abs(start[KAPPA]), np.abs(start[KAPPA] + start[KAPPA_RATE] * reach))
    missed_m = settings.bend_doubt * kappa * np.sqrt(kappa) * reach**3
    return points._replace(sigma_m=np.hypot(points.sigma_m, np.minimum(missed_m, MAX_MODEL_ERROR_M)))


def _shared_weight(points: RoadPoints, side: Array, settings: FitSettings) -> Array:
    """Information [1/m²] of each point: its own, or its share of the most that one boundary gives."""
    left = int(np.count_nonzero(side > 0))
    share_left = min(1.0, settings.points_per_boundary / max(left, 1))
    share_right = min(1.0, settings.points_per_boundary / max(len(side) - left, 1))
    return np.where(side > 0, share_left, share_right) * points.weight / points.sigma_m**2


def _robust_scale(points: RoadPoints, settings: FitSettings) -> Array:
    """Scale [m] of the Cauchy weight; larger residuals count less."""
    return np.maximum(2 * points.sigma_m, settings.robust_scale_m)


def _residuals(points: RoadPoints, side: Array, mean: Array, camera: Camera) -> tuple[Array, Array]:
    """Residuals [m], shape (n,), and their derivatives by the state, shape (6, n)."""
    _, psi, kappa, rate, width, pitch = mean.tolist()
    x_m, y_m = level_points(points, pitch, camera)
    jacobian = np.empty((6, len(side)))
    station, distance = lane_derivatives(x_m, y_m, mean, jacobian)
    course = kappa * station + rate / 2 * (station * station) - psi
    ahead, left = x_m - camera.x_m, y_m - camera.y_m
    jacobian[WIDTH] = -side / 2
    jacobian[PITCH] = ahead / -camera.height_m * (left * np.cos(course) - ahead * np.sin(course))
    return distance - side * (width / 2), jacobian
