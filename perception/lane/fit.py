"""The lane as a state, boundary points as linear looks at it, and the robust fit that joins the two.

State x = (e, ψ, κ0, κ', W, δ): lateral offset, heading error, curvature and its rate at the rear axle, lane width
(Dickmanns and Mysliwetz 1992), and how much further down the camera looks than its mounting says. The two
boundaries are parallel curves, so they share all of x but the sign of W/2.
"""

import cmath
import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.linalg.lapack import dposv

from perception.lane.points import RoadPoints
from trepid.camera import Camera
from trepid.config import Settings
from trepid.types import Array, Positive

E, PSI, KAPPA, KAPPA_RATE, WIDTH, PITCH = range(6)
IDENTITY = np.eye(6)
MIN_POINTS_FOR_PITCH = 8  # on the boundary with fewer
MOST_DOUBT_M = 2.0  # beyond half a lane, points say nothing
SMALL_STEP = 0.2  # standard deviations of the state: the fit has settled


class FitSettings(Settings):
    """Section ``fit`` of ``config/perception.yaml``."""

    iterations: Annotated[int, Field(ge=1, le=10)]
    gate_m: Positive
    robust_scale_m: Positive
    gate_growth: Annotated[float, Field(ge=0)]
    points_per_boundary: Positive
    bend_doubt: Annotated[float, Field(ge=0)]
    straight_log_odds: float


@dataclass(frozen=True)
class LaneState:
    """Mean and covariance of (e, ψ, κ0, κ', W, δ), shapes (6,) and (6, 6)."""

    mean: Array
    covariance: Array


@dataclass(frozen=True)
class Fitted:
    """A fitted state; per point the residual [m] and the final weight (0 = rejected)."""

    state: LaneState
    residual_m: Array
    weight: Array


def lane_coordinates(
    x_m: Array, y_m: Array, mean: Array, curvature_floor_1pm: float = 1e-10
) -> tuple[Array, Array, Array]:
    """Places (s, d) along and left of the lane centre, and the lateral scale 1 − κ·d, of road points.

    With n = −x·sinθ + y·cosθ, θ = −ψ, κ_v = κ0/(1 − κ0·e) (the concentric circle through the rear axle) and
    A = n − κ_v·(x² + y²)/2, the signed distance to that circle is exactly 2A/(1 + √(1 − 2·κ_v·A)). The clothoid
    term κ'·s³/6 is added to first order.
    """
    offset, heading, curvature, rate = mean[:WIDTH].tolist()
    sin, cos = math.sin(-heading), math.cos(-heading)
    kappa = curvature / max(1 - curvature * offset, 0.2)
    if abs(kappa) < curvature_floor_1pm:
        kappa = curvature_floor_1pm
    across = y_m * cos - x_m * sin
    along = x_m * cos + y_m * sin
    ahead, aside = kappa * along, 1 - kappa * across  # of the centre of the circle, in radii
    # 1 − 2κA = 1 − 2κn + κ²(x² + y²): the squared distance to that centre.
    root = np.sqrt(np.maximum(aside * aside + ahead * ahead, 0.01))
    distance = (across + across - kappa * (x_m * x_m + y_m * y_m)) / (1 + root)
    station = np.arctan2(ahead, aside) / kappa
    return station, distance + (offset - rate / 6 * (station * station * station)), root


def fit_lane(
    points: RoadPoints,
    side: Array,
    prior: LaneState,
    start: Array,
    camera: Camera,
    settings: FitSettings,
) -> Fitted:
    """Maximum a posteriori lane for ``points`` on the left (side +1) or right (−1) boundary.

    Gauss-Newton on r = d(p; x) − side·W/2 with Cauchy weights and the prior N(x̄, P): with the information
    N = Σ w·HᵀH/σ², x = x̄ + (P⁻¹ + N)⁻¹·Σ w·Hᵀ/σ²·(H·(x_k − x̄) − r). The points of a boundary share their errors
    (one line of paint, one camera), so all together they count as ``points_per_boundary`` points. How the camera
    pitches shows only where two boundaries run together: one alone cannot tell it from a bend.
    """
    precision = inverse(prior.covariance)
    mean = start.copy()
    points = _doubted(points, start, settings)
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
        before, mean = mean, _bounded(prior.mean + solved(information, right_side))
        step = mean - before
        residual = residual + step @ jacobian
        if iteration and step @ information @ step < SMALL_STEP**2:
            break
    return Fitted(
        state=LaneState(mean=mean, covariance=inverse(information)), residual_m=residual, weight=weight
    )


def solved(matrix: Array, right_side: Array) -> Array:
    """x of M·x = b for a symmetric positive definite M, by Cholesky: a tenth of the time of numpy.linalg.

    Raises numpy.linalg.LinAlgError when M is none.
    """
    _, solution, failed = dposv(matrix, right_side)
    if failed:
        raise np.linalg.LinAlgError(f"not positive definite: {matrix}")
    return np.asarray(solution, np.float64)


def inverse(matrix: Array) -> Array:
    """M⁻¹ of a symmetric positive definite M, symmetric to the last bit."""
    found = solved(matrix, IDENTITY)
    return (found + found.T) / 2


def log_evidence(
    fitted: Fitted, points: RoadPoints, side: Array, prior: LaneState, settings: FitSettings
) -> float:
    """How well ``prior`` foresaw the points: log ∫ p(points | x)·p(x) dx, but for a constant, after Laplace.

    A looser prior pays for its freedom by log|P⁻¹ + N|/|P⁻¹|, so a bend is only seen where it is needed
    (MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapter 28).
    """
    scale = _robust_scale(points, settings)
    shared = _shared_weight(points, side, settings)
    misfit = float(np.sum(shared * scale**2 * np.log1p((fitted.residual_m / scale) ** 2)))
    change = fitted.state.mean - prior.mean
    surprise = float(change @ np.linalg.solve(prior.covariance, change))
    occam = np.linalg.slogdet(prior.covariance)[1] - np.linalg.slogdet(fitted.state.covariance)[1]
    return -0.5 * (misfit + surprise + float(occam))


def _bounded(mean: Array) -> Array:
    """Keep the linearisation sane: |ψ| ≤ 0.7, |κ0| ≤ 0.12, |κ'| ≤ 0.02."""
    mean[PSI] = min(max(mean[PSI], -0.7), 0.7)
    mean[KAPPA] = min(max(mean[KAPPA], -0.12), 0.12)
    mean[KAPPA_RATE] = min(max(mean[KAPPA_RATE], -0.02), 0.02)
    return mean


def _doubted(points: RoadPoints, start: Array, settings: FitSettings) -> RoadPoints:
    """``points`` with what one clothoid may miss of a road that bends as ``start`` does, far ahead.

    A bend of curvature κ that is driven at v = √(a/κ) begins and ends at κ' = j/v³ = j·(κ/a)^{3/2}. If that happens
    halfway to the station s, the clothoid from here is κ'·(s/2)³/6 off there: σ = ``bend_doubt``·κ^{3/2}·s³.
    """
    reach = points.x_m
    kappa = np.maximum(abs(start[KAPPA]), np.abs(start[KAPPA] + start[KAPPA_RATE] * reach))
    missed_m = settings.bend_doubt * kappa * np.sqrt(kappa) * reach**3
    return replace(points, sigma_m=np.hypot(points.sigma_m, np.minimum(missed_m, MOST_DOUBT_M)))


def _shared_weight(points: RoadPoints, side: Array, settings: FitSettings) -> Array:
    """Information [1/m²] of each point: its own, or its share of what its boundary can tell."""
    left = int(np.count_nonzero(side > 0))
    share_left = min(1.0, settings.points_per_boundary / max(left, 1))
    share_right = min(1.0, settings.points_per_boundary / max(len(side) - left, 1))
    return np.where(side > 0, share_left, share_right) * points.weight / points.sigma_m**2


def _robust_scale(points: RoadPoints, settings: FitSettings) -> Array:
    """Residual [m] from which on a point counts less (Cauchy)."""
    return np.maximum(2 * points.sigma_m, settings.robust_scale_m)


def levelled(points: RoadPoints, pitch_rad: float, camera: Camera) -> tuple[Array, Array]:
    """Road places of ``points`` if the camera looks ``pitch_rad`` further down than its mounting says.

    To first order the distance from the foot point shrinks by the factor 1/(1 + δ·x/h).
    """
    ahead, left = points.x_m - camera.x_m, points.y_m - camera.y_m
    shrink = 1 / np.maximum(1 + pitch_rad * ahead / camera.height_m, 0.3)
    return camera.x_m + ahead * shrink, camera.y_m + left * shrink


def _residuals(points: RoadPoints, side: Array, mean: Array, camera: Camera) -> tuple[Array, Array]:
    """Residuals [m], shape (n,), and their derivatives by the state, shape (6, n)."""
    e, psi, kappa, rate, width, pitch = mean.tolist()
    x_m, y_m = levelled(points, pitch, camera)
    station, distance, root = lane_coordinates(x_m, y_m, mean)
    sin, cos = math.sin(-psi), math.cos(-psi)
    square = station * station
    cube = square * station / 6
    # Of the concentric circle through the axle: d_v = d − e + κ'·s³/6 and κ_v = κ0/(1 − κ0·e).
    to_axle_circle = distance - e + rate * cube
    by_bend = to_axle_circle * to_axle_circle - x_m * x_m - y_m * y_m
    by_bend /= 2 * max(1 - kappa * e, 0.2) ** 2 * root
    course = kappa * station + rate / 2 * square - psi
    ahead, left = x_m - camera.x_m, y_m - camera.y_m
    jacobian = np.empty((6, len(side)))
    jacobian[E] = 1 + by_bend * kappa**2
    jacobian[PSI] = (x_m * cos + y_m * sin) / root
    jacobian[KAPPA] = by_bend
    jacobian[KAPPA_RATE] = -cube
    jacobian[WIDTH] = -side / 2
    jacobian[PITCH] = ahead / -camera.height_m * (left * np.cos(course) - ahead * np.sin(course))
    return distance - side * (width / 2), jacobian


def subset(points: RoadPoints, chosen: NDArray[np.intp]) -> RoadPoints:
    """The points numbered ``chosen``."""
    return RoadPoints(
        x_m=points.x_m[chosen],
        y_m=points.y_m[chosen],
        sigma_m=points.sigma_m[chosen],
        weight=points.weight[chosen],
        band=points.band[chosen],
        half_m=points.half_m[chosen],
    )


@dataclass(frozen=True)
class LaneCurve:
    """Both boundaries of a lane as polylines in the vehicle frame, near to far; arrays of shape (n,)."""

    station_m: Array
    left_x_m: Array
    left_y_m: Array
    right_x_m: Array
    right_y_m: Array


def centre_line(
    station_m: Array, turned_rad: Array, *, offset_m: float, heading_rad: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """The lane centre at stations ``station_m``, where it has turned by ``turned_rad``, and its direction there.

    Both (n,), as x + iy: −i·e·exp(−iψ) + ∫exp(iφ) ds with φ = turned − ψ, by the trapezoidal rule.
    """
    along = np.exp(1j * (turned_rad - heading_rad))
    centre = np.zeros(len(station_m), np.complex128)
    np.cumsum((along[1:] + along[:-1]) * (np.diff(station_m) / 2), out=centre[1:])
    start = -1j * offset_m * cmath.exp(-1j * heading_rad)
    centre += start - np.interp(0.0, station_m, centre)
    return centre, along


def lane_curve(mean: Array, station_m: Array) -> LaneCurve:
    """Boundaries of the lane at stations ``station_m``, which begin at or below 0: the clothoid ± W/2 along n.

    φ(s) = −ψ + κ0·s + κ'·s²/2, centre = −e·n(φ(0)) + ∫(cos φ, sin φ) ds by the trapezoidal rule, cut where the
    lane has turned by more than 1.3 rad: what lies beyond is out of sight.
    """
    offset, heading, curvature, rate, width = mean[:PITCH].tolist()
    turned = station_m * (curvature + rate / 2 * station_m)
    keep = np.abs(turned) < 1.3
    if not keep.all():
        station_m, turned = station_m[keep], turned[keep]
    centre, along = centre_line(station_m, turned, offset_m=offset, heading_rad=heading)
    aside = 1j * width / 2 * along
    left, right = centre + aside, centre - aside
    return LaneCurve(
        station_m=station_m,
        left_x_m=left.real,
        left_y_m=left.imag,
        right_x_m=right.real,
        right_y_m=right.imag,
    )
