"""The lane as a state vector, points on the road, and the curves between the two.

State x = (e, ψ, κ0, κ', W, δ): lateral offset, heading error, curvature and its rate at the rear axle, lane
width (Dickmanns and Mysliwetz 1992), and the pitch of the camera beyond that of its mounting. The two
boundaries are parallel curves, so they share all of x but the sign of W/2.
"""

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.messages import SIGMA_AHEAD_M
from trepid.types import Array

E, PSI, KAPPA, KAPPA_RATE, WIDTH, PITCH = range(6)
BEND = slice(KAPPA, KAPPA_RATE + 1)  # (κ0, κ')
MIN_CURVATURE_1PM = 1e-10  # a straight lane is computed as this bend
MAX_TURN_RAD = 1.3  # a lane that has turned further is out of sight

AnyArray = NDArray[np.floating]


@dataclass(frozen=True)
class LaneState:
    """Mean and covariance of (e, ψ, κ0, κ', W, δ), shapes (6,) and (6, 6)."""

    mean: Array
    covariance: Array

    @property
    def clothoid(self) -> Lane:
        """The lane centre."""
        return Lane(*self.mean[[E, PSI, KAPPA, KAPPA_RATE]].tolist())

    @property
    def ahead_sigma_m(self) -> tuple[float, ...]:
        """Standard deviation σ = √(gᵀ·P·g) [m] of the lateral position of the lane centre at SIGMA_AHEAD_M."""
        variance_m2 = np.sum((SIGMA_GRADIENTS @ self.covariance) * SIGMA_GRADIENTS, axis=1)
        return tuple(np.sqrt(np.maximum(variance_m2, 0.0)).tolist())


def ahead_gradient(ahead_m: float) -> Array:
    """∂y/∂x = (-1, -ℓ, ℓ²/2, ℓ³/6, 0, 0), shape (6,), of the lane centre y = -e - ψ·ℓ + κ·ℓ²/2 + κ'·ℓ³/6."""
    return np.array([-1.0, -ahead_m, ahead_m**2 / 2, ahead_m**3 / 6, 0.0, 0.0])


SIGMA_GRADIENTS = np.array([ahead_gradient(ahead_m) for ahead_m in SIGMA_AHEAD_M])


class RoadPoints(NamedTuple):
    """Points in the vehicle frame that may belong to a boundary; arrays of shape (n,)."""

    x_m: Array
    y_m: Array
    sigma_m: Array  # lateral standard deviation of one point
    weight: Array  # 0..1, similarity to a boundary
    band: NDArray[np.int64]  # band of the grid that contains the point
    half_m: Array  # from the middle of a double line to its stripes; 0 for a single stripe

    def part(self, chosen: NDArray[np.intp]) -> "RoadPoints":
        """The points with the indices ``chosen``."""
        return RoadPoints._make(column[chosen] for column in self)


def lane_coordinates(x_m: Array, y_m: Array, mean: Array) -> tuple[Array, Array, Array]:
    """Places (s, d) along and left of the lane centre, and the lateral scale 1 − κ·d, of road points.

    With n = −x·sinθ + y·cosθ, θ = −ψ, κ_v = κ0/(1 − κ0·e) (the concentric circle through the rear axle) and A
    = n − κ_v·(x² + y²)/2, the signed distance to that circle is exactly 2A/(1 + √(1 − 2·κ_v·A)). The clothoid
    term κ'·s³/6 is added to first order.
    """
    offset, heading, curvature, rate = mean[:WIDTH].tolist()
    sin, cos = math.sin(-heading), math.cos(-heading)
    kappa = curvature / max(1 - curvature * offset, 0.2)
    if abs(kappa) < MIN_CURVATURE_1PM:
        kappa = MIN_CURVATURE_1PM
    across = y_m * cos - x_m * sin
    along = x_m * cos + y_m * sin
    ahead, aside = kappa * along, 1 - kappa * across  # of the centre of the circle, in radii
    # 1 − 2κA = 1 − 2κn + κ²(x² + y²): the squared distance to that centre.
    root = np.sqrt(np.maximum(aside * aside + ahead * ahead, 0.01))
    distance = (across + across - kappa * (x_m * x_m + y_m * y_m)) / (1 + root)
    station = np.arctan2(ahead, aside) / kappa
    return station, distance + (offset - rate / 6 * (station * station * station)), root


def lane_derivatives(x_m: Array, y_m: Array, mean: Array, out: Array) -> tuple[Array, Array]:
    """(s, d) of :func:`lane_coordinates`; the derivatives of d by (e, ψ, κ, κ') become the first rows of ``out``.

    Of the concentric circle through the axle: d_v = d - e + κ'·s³/6 and κ_v = κ0/(1 - κ0·e). The change of s in the
    clothoid term is left out.
    """
    e, psi, kappa, rate = mean[:WIDTH].tolist()
    station, distance, root = lane_coordinates(x_m, y_m, mean)
    cube = station * station * station / 6
    to_axle_circle = distance - e + rate * cube
    by_bend = to_axle_circle * to_axle_circle - x_m * x_m - y_m * y_m
    by_bend /= 2 * max(1 - kappa * e, 0.2) ** 2 * root
    out[E] = 1 + by_bend * kappa**2
    out[PSI] = (x_m * math.cos(-psi) + y_m * math.sin(-psi)) / root
    out[KAPPA] = by_bend
    out[KAPPA_RATE] = -cube
    return station, distance


def distances(x_m: Array, y_m: Array, means: Array) -> Array:
    """d of :func:`lane_coordinates` of road points (m,) for each of n lanes (n, ≥ 4), shape (n, m)."""
    offset, heading, curvature, rate = means[:, :WIDTH].T[..., None]
    sin, cos = np.sin(-heading), np.cos(heading)
    kappa = curvature / np.maximum(1 - curvature * offset, 0.2)
    kappa = np.where(np.abs(kappa) < MIN_CURVATURE_1PM, MIN_CURVATURE_1PM, kappa)
    across = y_m * cos - x_m * sin
    along = x_m * cos
    along += y_m * sin
    ahead, aside = kappa * along, 1 - kappa * across
    root = aside * aside
    root += ahead * ahead
    np.sqrt(np.maximum(root, 0.01, out=root), out=root)
    root += 1
    across += across
    across -= kappa * (x_m * x_m + y_m * y_m)
    across /= root
    across += offset
    bends = rate[:, 0] != 0  # an arctangent for the others would be the greatest part of the time
    if bends.any():
        station = np.arctan2(ahead[bends], aside[bends]) / kappa[bends]
        across[bends] -= rate[bends] / 6 * (station * station * station)
    return np.asarray(across)


def parallel_curve(
    x_m: AnyArray, heading_rad: AnyArray, curvature_1pm: AnyArray, place_m: AnyArray
) -> AnyArray:
    """Lateral place y at ``x_m`` of the circle parallel to (ψ, κ) through the axle, ``place_m`` to its left.

    With θ = −ψ, κ_d = κ/(1 − κ·d) and (x0, y0) = d·(−sin θ, cos θ): sin φ = sin θ + κ_d·(x − x0) and
    y = y0 + (x − x0)·(sin φ + sin θ)/(cos φ + cos θ), which has no division by the curvature.
    """
    sin, cos = np.sin(-heading_rad), np.cos(heading_rad)
    bend = curvature_1pm / np.maximum(1 - curvature_1pm * place_m, 0.2)
    run = x_m + place_m * sin
    sin_end = np.minimum(np.maximum(sin + bend * run, -0.98), 0.98)
    return place_m * cos + run * (sin_end + sin) / (np.sqrt(1 - sin_end * sin_end) + cos)


def level_points(points: RoadPoints, pitch_rad: float, camera: Camera) -> tuple[Array, Array]:
    """Road places (x, y) [m] of ``points`` for a camera pitched ``pitch_rad`` further down than its mounting.

    To first order the distance from the foot point shrinks by the factor 1/(1 + δ·x/h).
    """
    ahead, left = points.x_m - camera.x_m, points.y_m - camera.y_m
    shrink = 1 / np.maximum(1 + pitch_rad * ahead / camera.height_m, 0.3)
    return camera.x_m + ahead * shrink, camera.y_m + left * shrink


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


def lane_curve(mean: Array, station_m: Array) -> NDArray[np.complex128]:
    """The left and the right boundary at stations ``station_m``, which begin at or below 0: x + iy, shape (2, n).

    φ(s) = −ψ + κ0·s + κ'·s²/2, centre = −e·n(φ(0)) + ∫(cos φ, sin φ) ds by the trapezoidal rule, cut where
    the lane has turned by more than ``MAX_TURN_RAD``.
    """
    offset, heading, curvature, rate, width = mean[:PITCH].tolist()
    turned = station_m * (curvature + rate / 2 * station_m)
    keep = np.abs(turned) < MAX_TURN_RAD
    if not keep.all():
        station_m, turned = station_m[keep], turned[keep]
    centre, along = centre_line(station_m, turned, offset_m=offset, heading_rad=heading)
    aside = 1j * width / 2 * along
    return np.stack([centre + aside, centre - aside])
