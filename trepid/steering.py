"""From the lane in the vehicle frame to the road-wheel angle of a kinematic vehicle. Used by CV and CNN alike."""

import math
from typing import Annotated

from pydantic import Field

from trepid.config import Settings


class SteeringSettings(Settings):
    """Section ``steering`` of ``config/perception.yaml``."""

    lookahead_m: Annotated[float, Field(gt=0)]


def lane_centre_m(
    x_m: float, *, offset_m: float, heading_rad: float, curvature_1pm: float, curvature_rate_1pm2: float
) -> float:
    """Lateral place y [m] of the lane centre at ``x_m`` ahead of the rear axle, for small angles.

    y(x) = −e − ψ·x + κ0·x²/2 + κ'·x³/6 (Dickmanns and Mysliwetz, Recursive 3-D road and relative ego-state
    recognition, IEEE PAMI 14(2), 1992). ``curvature_1pm`` holds at the rear axle here.
    """
    return -offset_m - heading_rad * x_m + curvature_1pm * x_m**2 / 2 + curvature_rate_1pm2 * x_m**3 / 6


def pursuit_curvature(
    lookahead_m: float,
    *,
    offset_m: float,
    heading_rad: float,
    curvature_1pm: float,
    curvature_rate_1pm2: float,
) -> float:
    """Curvature κ_cmd [1/m], + left, of the arc through the rear axle and the lane centre at ``lookahead_m``.

    κ_cmd = 2·y(ℓ)/ℓ², with ℓ measured along x: the pure pursuit of Coulter, Implementation of the Pure Pursuit
    Path Tracking Algorithm, CMU-RI-TR-92-01, eq. 3 with D² = ℓ² for small y.
    """
    y_m = lane_centre_m(
        lookahead_m,
        offset_m=offset_m,
        heading_rad=heading_rad,
        curvature_1pm=curvature_1pm,
        curvature_rate_1pm2=curvature_rate_1pm2,
    )
    return 2 * y_m / lookahead_m**2


def road_wheel_angle(curvature_1pm: float, *, wheelbase_m: float) -> float:
    """Road-wheel angle [rad], + left, that drives ``curvature_1pm`` without slip: δ = atan(L·κ).

    Rajamani, Vehicle Dynamics and Control (2012), section 2.2. Understeer is the controller's business.
    """
    return math.atan(wheelbase_m * curvature_1pm)
