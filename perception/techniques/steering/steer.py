"""From boundaries and lane state to the road-wheel angle."""

from typing import Annotated

from pydantic import Field

from perception.techniques.image.picture import Boundaries, Lane, View
from trepid.steering import pursuit_curvature, road_wheel_angle


def pursuit(
    boundaries: Boundaries,
    lane: Lane | None,
    view: View,
    wheelbase_m: float,
    dt_s: float,
    *,
    lookahead_m: Annotated[float, Field(gt=0)] = 8.0,
) -> float | None:
    """Road-wheel angle [rad], + left, of the arc to the lane centre ``lookahead_m`` ahead: δ = atan(L·2y/ℓ²).

    Source: Coulter, CMU-RI-TR-92-01; 8 m is about 1 s at the speeds of the shuttle. None without a lane.
    """
    if lane is None:
        return None
    curvature_1pm = pursuit_curvature(
        lookahead_m,
        offset_m=lane.offset_m,
        heading_rad=lane.heading_rad,
        curvature_1pm=lane.curvature_1pm,
        curvature_rate_1pm2=lane.curvature_rate_1pm2,
    )
    return road_wheel_angle(curvature_1pm, wheelbase_m=wheelbase_m)
